"""Ordinary and weighted least squares on triangular factors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from scipy.linalg import solve_triangular

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import DataError
from loopid.identification.excitation import require_excitation
from loopid.identification.problem import FitProblem
from loopid.identification.quality import fit_quality
from loopid.identification.result import FitResult
from loopid.threads import one_blas_thread

WEIGHT_ITERATIONS = 500
WEIGHT_TOLERANCE = 1e-10  # relative change of the weights that ends the iteration
# Residual of an actuator, relative to its force, and freedom of it, relative to its samples, that
# are but round-off.
EXACT_FIT = 1e-10


class Estimator(ABC):
    """A way of finding parameters from a fit problem."""

    name: ClassVar[str]

    def fit(self, problem: FitProblem) -> FitResult:
        """Estimate the parameters, with the covariance for independent errors.

        Raises
        ------
        DataError
            When there are not more rows than parameters.
        RankError
            When the data do not excite a combination of parameters.
        """
        if _freedom(problem) < 1:
            count = len(problem.parameters)
            raise DataError(f"{problem.rows} rows cannot determine {count} parameters")
        with one_blas_thread():
            return self._fit(problem)

    @abstractmethod
    def _fit(self, problem: FitProblem) -> FitResult: ...


class OrdinaryLeastSquares(Estimator):
    """All actuators count alike: errors of one variance for all."""

    name = "ols"

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = np.where(problem.samples > 0, 1.0, 0.0)
        values, R = _solve(problem, weights)
        variance = problem.residual_squares(values).sum() / _freedom(problem)
        return _result(self.name, problem, values, R, weights, variance)


class WeightedLeastSquares(Estimator):
    """Each actuator counts by its own error variance, found by iteration [Gautier1997]."""

    name = "wls"

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = np.where(problem.samples > 0, 1.0, 0.0)
        present = weights > 0
        for _ in range(WEIGHT_ITERATIONS):
            values, R = _solve(problem, weights)
            last, weights = weights, _inverse_deviations(problem, values, weights, R)
            if np.abs(weights[present] / last[present] - 1.0).max() <= WEIGHT_TOLERANCE:
                values, R = _solve(problem, weights)
                return _result(self.name, problem, values, R, weights, 1.0)
        raise DataError(f"the weights do not settle in {WEIGHT_ITERATIONS} iterations: use OLS")


def exactly_fitted(problem: FitProblem, values: FloatArray) -> BoolArray:
    """Which actuators (dof,) have residuals that are but round-off."""
    squares = problem.residual_squares(values)
    return np.asarray(squares <= EXACT_FIT**2 * problem.force_squares(), dtype=np.bool_)


def _freedom(problem: FitProblem) -> int:
    return problem.rows - len(problem.parameters)


def _solve(problem: FitProblem, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Estimates (n,) and the triangular factor (n, n) of the weighted regressor."""
    width = len(problem.parameters)
    R = problem.weighted(weights)
    require_excitation(problem, R[:width, :width])
    values = solve_triangular(R[:width, :width], R[:width, width])
    return np.asarray(values, dtype=np.float64), R[:width, :width]


def _inverse_deviations(
    problem: FitProblem, values: FloatArray, weights: FloatArray, R: FloatArray
) -> FloatArray:
    """Weights (dof,) from residuals over each actuator's own share of the freedom.

    An actuator's share is its samples less its leverage, the part of the parameters that it
    determines; 0 for an actuator without samples. Errors are at least what counts as round-off.
    """
    columns = weights[:, None, None] * problem.factors[:, :, :-1] @ np.linalg.inv(R)
    freedom = problem.samples - (columns**2).sum(axis=(1, 2))
    squares, present = problem.residual_squares(values), problem.samples > 0
    exact = exactly_fitted(problem, values) | (freedom <= EXACT_FIT * problem.samples)
    refused = exact & present & (problem.least_errors == 0)
    if refused.any():
        name = problem.actuators[int(np.flatnonzero(refused)[0])]
        raise DataError(f"actuator {name} is fitted without error: weights are undefined; use OLS")
    found = np.zeros(len(weights))
    variances = np.divide(squares, freedom, out=found.copy(), where=freedom > 0)
    least = np.maximum(variances, problem.least_errors**2)
    found[present] = 1.0 / np.sqrt(least[present])
    return found


def _result(
    name: str,
    problem: FitProblem,
    values: FloatArray,
    R: FloatArray,
    weights: FloatArray,
    variance: float,
) -> FitResult:
    inverse = np.linalg.inv(R)
    return FitResult(
        estimator=name,
        parameters=problem.parameters,
        actuators=problem.actuators,
        values=values,
        covariance=variance * inverse @ inverse.T,
        condition_number=float(np.linalg.cond(R)),
        degrees_of_freedom=float(_freedom(problem)),
        quality=fit_quality(problem, values),
        weights=weights,
    )
