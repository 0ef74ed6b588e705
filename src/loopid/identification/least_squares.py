"""Ordinary and weighted least squares on triangular factors."""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import DataError
from loopid.identification.estimator import (
    Estimator,
    freedom_of,
    leverages,
    result_of,
    solved,
)
from loopid.identification.problem import FitProblem
from loopid.identification.result import FitResult

WEIGHT_ITERATIONS = 500
WEIGHT_TOLERANCE = 1e-10  # relative change of the weights that ends the iteration
# Residual of an actuator, relative to its force, and freedom of it, relative to its samples, that
# are but round-off.
EXACT_FIT = 1e-10


class OrdinaryLeastSquares(Estimator):
    """All actuators count alike: errors of one variance for all."""

    name = "ols"

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = equal_weights(problem)
        values, R = solved(problem, weights)
        variance = problem.residual_squares(values).sum() / freedom_of(problem)
        return result_of(self.name, problem, values, R, weights, variance)


class WeightedLeastSquares(Estimator):
    """Each actuator counts by its own error variance, found by iteration [Gautier1997]."""

    name = "wls"

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = equal_weights(problem)
        for _ in range(WEIGHT_ITERATIONS):
            values, R = solved(problem, weights)
            last, freedom = weights, problem.samples - leverages(problem, weights, R)
            weights = inverse_deviations(problem, problem.residual_squares(values), freedom)
            if settled(weights, last):
                values, R = solved(problem, weights)
                return result_of(self.name, problem, values, R, weights, 1.0)
        raise unsettled()


def equal_weights(problem: FitProblem) -> FloatArray:
    """1 for each actuator (dof,) with samples, 0 for the others."""
    return np.where(problem.samples > 0, 1.0, 0.0)


def settled(weights: FloatArray, last: FloatArray) -> bool:
    """Whether weights (dof,) have stopped to change."""
    present = weights > 0
    change = np.abs(weights[present] / last[present] - 1.0)
    return bool(change.max(initial=0.0) <= WEIGHT_TOLERANCE)


def unsettled() -> DataError:
    """What to say when weights do not settle."""
    return DataError(f"the weights do not settle in {WEIGHT_ITERATIONS} iterations: use OLS")


def exactly_fitted(problem: FitProblem, squares: FloatArray) -> BoolArray:
    """Which actuators (dof,) have sums of squared residuals (dof,) that are but round-off."""
    return np.asarray(squares <= EXACT_FIT**2 * problem.force_squares(), dtype=np.bool_)


def inverse_deviations(problem: FitProblem, squares: FloatArray, freedom: FloatArray) -> FloatArray:
    """Weights (dof,) from sums of squared residuals (dof,) over each actuator's freedom (dof,).

    An actuator's freedom is its samples less its leverage. Errors are at least what counts as
    round-off. Actuators without samples have weight 0.
    """
    present = problem.samples > 0
    exact = exactly_fitted(problem, squares) | (freedom <= EXACT_FIT * problem.samples)
    refused = exact & present & (problem.least_errors == 0)
    if refused.any():
        name = problem.actuators[int(np.flatnonzero(refused)[0])]
        raise DataError(f"actuator {name} is fitted without error: weights are undefined; use OLS")
    found = np.zeros(len(squares))
    variances = np.divide(squares, freedom, out=found.copy(), where=freedom > 0)
    least = np.maximum(variances, problem.least_errors**2)
    found[present] = 1.0 / np.sqrt(least[present])
    return found
