"""What an estimator is, and the registry of all of them: a new one is a file and a line.

An estimator may clip forces, project regressors or use prior knowledge; its estimates still solve
Σ x_t (y_t - x_tᵀ φ) = 0 for some regressor x and forces y, the *working* samples. Their residuals
are the errors that add up in the estimates, so that one computation of the uncertainty, which
allows for autocorrelated residuals, serves all estimators.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy.linalg import cho_solve

from loopid.arguments import FloatArray, row_blocks
from loopid.errors import DataError, OptionError
from loopid.identification.problem import FitProblem, FitSamples
from loopid.identification.result import FitResult
from loopid.records import record
from loopid.registry import Registry
from loopid.workers import one_blas_thread


@record
class WorkingFit:
    """A fit, and the least squares that it amounts to.

    Attributes
    ----------
    result : FitResult
    samples : FitSamples
        Working samples: with the weights of the result, and the rows of the prior, their least
        squares are the values of the result.
    prior : FloatArray or None
        (k, n + 1), rows [L | L φ₀] of the prior, their errors of unit variance.
    """

    result: FitResult
    samples: FitSamples
    prior: FloatArray | None = None

    @property
    def factor(self) -> FloatArray:
        """Triangular factor (n + 1, n + 1) of all weighted rows, those of the prior included."""
        return self.samples.problem.weighted(self.result.weights, self.prior)

    def response(self, force: FloatArray) -> FloatArray:
        """Change of the estimates (n, k) with further forces (N, dof, k)."""
        width = len(self.result.parameters)
        sums = np.zeros((width, force.shape[2]))
        for rows in row_blocks(len(self.samples)):
            weights = self.result.weights**2 * self.samples.used[rows]
            columns = self.samples.regressor[rows] * weights[:, :, None]
            sums += np.einsum("tij,tik->jk", columns, force[rows], optimize=True)
        return np.asarray(cho_solve((self.factor[:width, :width], False), sums))


class Estimator:
    """A way of finding parameters: a record of its options with ``_fit`` or ``fit_samples``.

    Triangular factors are enough for ``_fit``, which finds a ``FitResult`` for independent errors;
    an estimator that needs the samples has ``fit_samples`` instead. A new one is a file, and a line
    in ``ESTIMATORS``.
    """

    name: ClassVar[str]

    def fit(self, problem: FitProblem) -> FitResult:
        """Estimate the parameters, with the covariance for independent errors.

        Raises
        ------
        OptionError
            When the estimator needs the samples themselves.
        DataError
            When there are not more rows than parameters.
        RankError
            When the data do not excite a combination of parameters.
        """
        require_rows(problem)
        with one_blas_thread():
            return self._fit(problem)

    def fit_samples(self, samples: FitSamples) -> WorkingFit:
        """Estimate the parameters as ``fit``, and state the least squares that they solve."""
        return WorkingFit(self.fit(samples.problem), samples)

    def _fit(self, problem: FitProblem) -> FitResult:
        raise OptionError(
            f"{self.name} needs the samples, not only their triangular factors: "
            "use fit(samples, estimator)"
        )


ESTIMATORS: Registry[type[Estimator]] = Registry(
    "estimator",
    {
        "ols": "loopid.identification.ordinary:OrdinaryLeastSquares",
        "wls": "loopid.identification.weighted:WeightedLeastSquares",
        "bisquare": "loopid.identification.robust:Bisquare",
        "iv": "loopid.identification.instrumental:InstrumentalVariables",
        "bayes": "loopid.identification.bayes:BayesianRidge",
    },
)


def chosen_estimator(estimator: str | Estimator) -> Estimator:
    """An estimator, or the one with a name."""
    return estimator if isinstance(estimator, Estimator) else ESTIMATORS[estimator]()


def require_rows(problem: FitProblem) -> None:
    """Refuse problems with no more rows than parameters."""
    if problem.freedom < 1:
        count = len(problem.parameters)
        raise DataError(
            f"{problem.rows} rows cannot determine {count} parameters",
            rows=problem.rows,
            parameters=count,
        )
