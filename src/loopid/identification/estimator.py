"""What all estimators are: least squares on working samples.

An estimator may clip forces, project regressors or know something beforehand; its estimates still
solve Σ x_t (y_t - x_tᵀ φ) = 0 for some regressor x and forces y, the *working* samples. Their
residuals are the errors that add up in the estimates, so that one computation of the uncertainty,
which allows for errors that follow one another, does for all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from loopid.arrays import FloatArray
from loopid.errors import DataError, OptionError
from loopid.identification.excitation import require_excitation
from loopid.identification.problem import FitProblem
from loopid.identification.quality import fit_quality
from loopid.identification.result import FitResult
from loopid.identification.samples import FitSamples
from loopid.scratch import row_blocks
from loopid.threads import one_blas_thread
from loopid.triangular import triangular_factor


@dataclass(frozen=True)
class WorkingFit:
    """A fit, and the least squares that it amounts to.

    Attributes
    ----------
    result : FitResult
    samples : FitSamples
        Working samples: with the weights of the result, and the rows of the prior, their least
        squares are the values of the result.
    prior : FloatArray or None
        (k, n + 1), rows [L | L φ₀] of what was known beforehand, their errors of unit variance.
    """

    result: FitResult
    samples: FitSamples
    prior: FloatArray | None = None

    @property
    def factor(self) -> FloatArray:
        """Triangular factor (n + 1, n + 1) of all weighted rows, those of the prior included."""
        return whole_factor(self.samples.problem, self.result.weights, self.prior)

    def response(self, force: FloatArray) -> FloatArray:
        """How the estimates (n, k) move with further forces (N, dof, k)."""
        width = len(self.result.parameters)
        sums = np.zeros((width, force.shape[2]))
        for rows in row_blocks(len(self.samples)):
            weights = self.result.weights**2 * self.samples.used[rows]
            columns = self.samples.regressor[rows] * weights[:, :, None]
            sums += np.einsum("tij,tik->jk", columns, force[rows], optimize=True)
        return np.asarray(cho_solve((self.factor[:width, :width], False), sums))


class Estimator(ABC):
    """A way of finding parameters from samples, or from what is left of them in a problem."""

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
        """Estimate the parameters, and say which least squares they solve.

        Raises
        ------
        DataError, RankError
            As ``fit``.
        """
        return WorkingFit(self.fit(samples.problem), samples)

    @abstractmethod
    def _fit(self, problem: FitProblem) -> FitResult: ...


class SampleEstimator(Estimator):
    """An estimator that looks at each sample, which triangular factors do not tell."""

    def _fit(self, problem: FitProblem) -> FitResult:
        raise OptionError(
            f"{self.name} needs the samples, not only their triangular factors: "
            "use fit(samples, estimator)"
        )

    @abstractmethod
    def fit_samples(self, samples: FitSamples) -> WorkingFit:
        """As of ``Estimator``."""


def freedom_of(problem: FitProblem) -> int:
    """Rows less parameters."""
    return problem.rows - len(problem.parameters)


def require_rows(problem: FitProblem) -> None:
    """Refuse problems with no more rows than parameters."""
    if freedom_of(problem) < 1:
        count = len(problem.parameters)
        raise DataError(f"{problem.rows} rows cannot determine {count} parameters")


def whole_factor(
    problem: FitProblem, weights: FloatArray, prior: FloatArray | None = None
) -> FloatArray:
    """Triangular factor (n + 1, n + 1) of the weighted rows of a problem and those of a prior."""
    factor = problem.weighted(weights)
    return factor if prior is None else triangular_factor(np.concatenate([factor, prior]))


def solved(problem: FitProblem, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least squares (n,) and the triangular factor (n, n) of the weighted regressor."""
    width = len(problem.parameters)
    R = problem.weighted(weights)
    require_excitation(problem, R[:width, :width])
    values = solve_triangular(R[:width, :width], R[:width, width])
    return np.asarray(values, dtype=np.float64), R[:width, :width]


def leverages(problem: FitProblem, weights: FloatArray, R: FloatArray) -> FloatArray:
    """Part of the parameters (dof,) that each actuator determines; they sum to n without a prior.

    Parameters
    ----------
    R : FloatArray
        (n, n), factor of all weighted rows.
    """
    columns = weights[:, None, None] * problem.factors[:, :, :-1] @ np.linalg.inv(R)
    return np.asarray((columns**2).sum(axis=(1, 2)), dtype=np.float64)


def result_of(
    name: str,
    problem: FitProblem,
    values: FloatArray,
    R: FloatArray,
    weights: FloatArray,
    variance: float,
) -> FitResult:
    """The result whose covariance for independent errors is variance · (RᵀR)⁻¹."""
    inverse = np.linalg.inv(R)
    return FitResult(
        estimator=name,
        parameters=problem.parameters,
        actuators=problem.actuators,
        values=values,
        covariance=variance * inverse @ inverse.T,
        condition_number=float(np.linalg.cond(R)),
        degrees_of_freedom=float(freedom_of(problem)),
        quality=fit_quality(problem, values),
        weights=weights,
    )
