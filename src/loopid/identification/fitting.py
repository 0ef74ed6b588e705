"""One call from samples to parameters with intervals that hold."""

from __future__ import annotations

from loopid.errors import OptionError
from loopid.identification.correlation import warn_of_correlation, with_correlated_errors
from loopid.identification.excitation import warn_of_unsupported
from loopid.identification.least_squares import (
    Estimator,
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from loopid.identification.result import FitResult
from loopid.identification.samples import FitSamples

ESTIMATORS: dict[str, type[Estimator]] = {
    "ols": OrdinaryLeastSquares,
    "wls": WeightedLeastSquares,
}


def fit(samples: FitSamples, estimator: str | Estimator = "wls") -> FitResult:
    """Estimate parameters, with intervals for errors that follow one another.

    Parameters
    ----------
    samples : FitSamples
    estimator : str or Estimator
        ``"wls"``, ``"ols"`` or an estimator.

    Returns
    -------
    FitResult
        With a model of the errors in ``noise``.

    Raises
    ------
    DataError, RankError
        As ``Estimator.fit``.

    Warns
    -----
    CorrelationWarning
        When errors follow one another so much that there are clearly fewer effective samples.
    ExcitationWarning
        Naming the parameters whose 95 % interval includes zero.
    """
    independent = chosen_estimator(estimator).fit(samples.problem)
    result = with_correlated_errors(independent, samples)
    warn_of_correlation(result, independent)
    warn_of_unsupported(result)
    return result


def quiet_fit(samples: FitSamples, estimator: str | Estimator = "wls") -> FitResult:
    """As ``fit``, without warnings."""
    return with_correlated_errors(chosen_estimator(estimator).fit(samples.problem), samples)


def chosen_estimator(estimator: str | Estimator) -> Estimator:
    """An estimator, or the one with a name."""
    if isinstance(estimator, Estimator):
        return estimator
    if estimator not in ESTIMATORS:
        raise OptionError.unknown("estimator", estimator, ESTIMATORS)
    return ESTIMATORS[estimator]()
