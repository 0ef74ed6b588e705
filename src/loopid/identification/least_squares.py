"""Ordinary and weighted least squares on triangular factors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from scipy.linalg import solve_triangular

from loopid.arrays import FloatArray
from loopid.errors import DataError, RankError
from loopid.identification.problem import FitProblem
from loopid.identification.result import FitResult, fit_quality
from loopid.threads import one_blas_thread

# Smallest over largest singular value, of columns scaled to unit length, that data must excite.
LEAST_EXCITATION = 1e-8
WEIGHT_ITERATIONS = 50
WEIGHT_TOLERANCE = 1e-10  # relative change of the weights that ends the iteration


class Estimator(ABC):
    """A way of finding parameters from a fit problem."""

    name: ClassVar[str]

    def fit(self, problem: FitProblem) -> FitResult:
        """Estimate the parameters.

        Raises
        ------
        DataError
            When there are not more rows than parameters.
        RankError
            When the data do not excite a combination of parameters.
        """
        if _freedom(problem) < 1:
            rows = problem.samples * len(problem.actuators)
            raise DataError(f"{rows} rows cannot determine {len(problem.parameters)} parameters")
        with one_blas_thread():
            return self._fit(problem)

    @abstractmethod
    def _fit(self, problem: FitProblem) -> FitResult: ...


class OrdinaryLeastSquares(Estimator):
    """All actuators count alike: errors of one variance for all."""

    name = "ols"

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = np.ones(len(problem.actuators))
        values, R = _solve(problem, weights)
        variance = problem.residual_squares(values).sum() / _freedom(problem)
        return _result(self.name, problem, values, R, variance)


class WeightedLeastSquares(Estimator):
    """Each actuator counts by its own error variance, found by iteration [Gautier1997]."""

    name = "wls"

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = np.ones(len(problem.actuators))
        per_actuator = _freedom(problem) / len(problem.actuators)
        for _ in range(WEIGHT_ITERATIONS):
            values, R = _solve(problem, weights)
            deviations = np.sqrt(problem.residual_squares(values) / per_actuator)
            if not (deviations > 0).all():
                exact = problem.actuators[int(deviations.argmin())]
                raise DataError(f"actuator {exact} is fitted without error: weights are undefined")
            last, weights = weights, 1.0 / deviations
            if np.abs(weights / last - 1.0).max() <= WEIGHT_TOLERANCE:
                values, R = _solve(problem, weights)
                return _result(self.name, problem, values, R, 1.0)
        raise DataError(f"the weights do not settle in {WEIGHT_ITERATIONS} iterations: use OLS")


def _freedom(problem: FitProblem) -> int:
    return problem.samples * len(problem.actuators) - len(problem.parameters)


def _solve(problem: FitProblem, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Estimates (n,) and the triangular factor (n, n) of the weighted regressor."""
    width = len(problem.parameters)
    stacked = (weights[:, None, None] * problem.factors).reshape(-1, width + 1)
    R = np.asarray(np.linalg.qr(stacked, mode="r"), dtype=np.float64)
    _require_excitation(problem, R[:width, :width])
    values = solve_triangular(R[:width, :width], R[:width, width])
    return np.asarray(values, dtype=np.float64), R[:width, :width]


def _require_excitation(problem: FitProblem, R: FloatArray) -> None:
    labels, norms = problem.parameters.labels, np.linalg.norm(R, axis=0)
    if not (norms > 0).all():
        raise RankError(f"the data do not show {labels[int(norms.argmin())]} at all")
    _, values, right = np.linalg.svd(R / norms)
    if values[-1] >= LEAST_EXCITATION * values[0]:
        return
    involved = np.flatnonzero(np.abs(right[-1]) > 0.1 * np.abs(right[-1]).max())
    raise RankError(
        f"the data do not tell {', '.join(labels[j] for j in involved)} apart: relative singular "
        f"value {values[-1] / values[0]:.1e} (least {LEAST_EXCITATION:g}); fit base parameters, or "
        "excite them"
    )


def _result(
    name: str, problem: FitProblem, values: FloatArray, R: FloatArray, variance: float
) -> FitResult:
    inverse = np.linalg.inv(R)
    return FitResult(
        estimator=name,
        parameters=problem.parameters,
        actuators=problem.actuators,
        values=values,
        covariance=variance * inverse @ inverse.T,
        condition_number=float(np.linalg.cond(R)),
        degrees_of_freedom=_freedom(problem),
        quality=fit_quality(problem, values),
    )
