"""One call from samples to parameters with intervals that hold."""

from __future__ import annotations

from loopid.arguments import checked
from loopid.errors import OptionError
from loopid.identification.bayes import BayesianRidge
from loopid.identification.correlation import warn_of_correlation, with_correlated_errors
from loopid.identification.estimator import Estimator, WorkingFit
from loopid.identification.excitation import warn_of_unsupported
from loopid.identification.instrumental import InstrumentalVariables
from loopid.identification.least_squares import OrdinaryLeastSquares, WeightedLeastSquares
from loopid.identification.result import FitResult
from loopid.identification.robust import Bisquare, Huber
from loopid.identification.samples import FitSamples
from loopid.identification.total_least_squares import TotalLeastSquares

ESTIMATORS: dict[str, type[Estimator]] = {
    "ols": OrdinaryLeastSquares,
    "wls": WeightedLeastSquares,
    "huber": Huber,
    "bisquare": Bisquare,
    "tls": TotalLeastSquares,
    "iv": InstrumentalVariables,
    "bayes": BayesianRidge,
}


@checked
def fit(samples: FitSamples, estimator: str | Estimator = "wls") -> FitResult:
    """Estimate parameters, with intervals for errors that follow one another.

    Parameters
    ----------
    samples : FitSamples
    estimator : str or Estimator
        A name of ``ESTIMATORS``, or an estimator with its options. ``"iv"`` needs samples with
        instruments; ``"bayes"`` a prior, ``BayesianRidge(prior)``.

    Returns
    -------
    FitResult
        With a model of the errors in ``noise``.

    Raises
    ------
    OptionError
        When there is no such estimator, or something that it needs is not given.
    DataError, RankError
        As ``Estimator.fit``.

    Warns
    -----
    CorrelationWarning
        When errors follow one another so much that there are clearly fewer effective samples.
    ExcitationWarning
        Naming the parameters whose 95 % interval includes zero.
    """
    fitted, independent = fits(samples, estimator)
    warn_of_correlation(fitted.result, independent)
    warn_of_unsupported(fitted.result)
    return fitted.result


@checked
def quiet_fit(samples: FitSamples, estimator: str | Estimator = "wls") -> FitResult:
    """As ``fit``, without warnings."""
    return working_fit(samples, estimator).result


@checked
def working_fit(samples: FitSamples, estimator: str | Estimator = "wls") -> WorkingFit:
    """As ``quiet_fit``, with the least squares that the fit amounts to."""
    return fits(samples, estimator)[0]


def fits(samples: FitSamples, estimator: str | Estimator) -> tuple[WorkingFit, FitResult]:
    """The fit, and its result for independent errors."""
    independent = chosen_estimator(estimator).fit_samples(samples)
    return with_correlated_errors(independent), independent.result


def chosen_estimator(estimator: str | Estimator) -> Estimator:
    """An estimator, or the one with a name."""
    if isinstance(estimator, Estimator):
        return estimator
    if estimator not in ESTIMATORS:
        raise OptionError.unknown("estimator", estimator, ESTIMATORS)
    return ESTIMATORS[estimator]()
