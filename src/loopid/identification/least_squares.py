"""Ordinary and weighted least squares on triangular factors, which all estimators build on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from loopid.arguments import FloatArray
from loopid.errors import (
    DataError,
    RankError,
)
from loopid.identification.estimator import Estimator
from loopid.identification.problem import (
    ROUND_OFF,
    FitProblem,
)
from loopid.identification.result import (
    FitResult,
    fit_quality,
)

# Smallest over largest singular value, of columns scaled to unit length, that data must excite.
LEAST_EXCITATION = 1e-8
# Part in the unidentifiable directions, relative to the largest, above which a parameter is named.
INVOLVED = 0.1
WEIGHT_ITERATIONS = 500
# Change of the weights that ends the iteration: relative, or round-off of the forces relative to
# the errors, which is all that is known of these where they are small.
WEIGHT_TOLERANCE, WEIGHT_ROUND_OFF = 1e-10, 1e-13


class OrdinaryLeastSquares(Estimator):
    """All actuators count alike: errors of one variance for all."""

    name = "ols"

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = equal_weights(problem)
        values, R = solved(problem, weights)
        variance = problem.residual_squares(values).sum() / problem.freedom
        return result_of(self.name, problem, values, R, weights, variance)


class WeightedLeastSquares(Estimator):
    """Each actuator counts by its own error variance, found by iteration [Gautier1997]."""

    name = "wls"

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = least_squares_weights(problem)
        values, R = solved(problem, weights)
        return result_of(self.name, problem, values, R, weights, 1.0)


def solved(
    problem: FitProblem, weights: FloatArray, prior: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Least squares (n,) of the weighted rows and a prior's, and their triangular factor (n, n)."""
    width = len(problem.parameters)
    factor = problem.weighted(weights, prior)
    R = factor[:width, :width]
    require_excitation(problem, R)
    return np.asarray(solve_triangular(R, factor[:width, width]), dtype=np.float64), R


def leverages(problem: FitProblem, weights: FloatArray, R: FloatArray) -> FloatArray:
    """Part of the parameters (dof,) that each actuator determines; they sum to n without a prior.

    By the triangular factor R (n, n) of all weighted rows.
    """
    columns = weights[:, None, None] * problem.factors[:, :, :-1] @ np.linalg.inv(R)
    return np.asarray((columns**2).sum(axis=(1, 2)), dtype=np.float64)


def equal_weights(problem: FitProblem) -> FloatArray:
    """1 for each actuator (dof,) with samples, 0 for the others."""
    return np.where(problem.samples > 0, 1.0, 0.0)


def inverse_deviations(problem: FitProblem, squares: FloatArray, freedom: FloatArray) -> FloatArray:
    """Weights (dof,) from sums of squared residuals (dof,) over each actuator's freedom (dof,).

    The freedom of an actuator is its samples less its leverage. Errors are at least the stated
    ones, or the round-off of the forces: noise-free data have finite weights. Actuators without
    samples have weight 0.
    """
    present, left = problem.samples > 0, freedom > ROUND_OFF * problem.samples
    variances = np.divide(squares, freedom, out=np.zeros(len(squares)), where=left)
    least = np.maximum(problem.least_errors, ROUND_OFF * problem.force_rms)
    deviations = np.sqrt(np.maximum(variances, least**2))
    undefined = present & ((deviations == 0) | (~left & (problem.least_errors == 0)))
    if undefined.any():
        name = problem.actuators[int(undefined.argmax())]
        raise DataError(
            f"actuator {name} is fitted without error: its weight is undefined; use ols"
        )
    return np.where(present, 1.0 / np.where(present, deviations, 1.0), 0.0)


def converged_weights(
    problem: FitProblem, fitted: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
) -> FloatArray:
    """Weights (dof,) that are the inverse deviations of the residuals that they lead to.

    Of given weights (dof,), ``fitted`` makes the values (n,) and leverages (dof,) of the fit.
    """
    weights = equal_weights(problem)
    present, force = weights > 0, problem.force_rms
    for _ in range(WEIGHT_ITERATIONS):
        values, leverage = fitted(weights)
        last, squares = weights, problem.residual_squares(values)
        weights = inverse_deviations(problem, squares, problem.samples - leverage)
        change = np.abs(weights[present] / last[present] - 1.0).max(initial=0.0)
        if change <= max(WEIGHT_TOLERANCE, WEIGHT_ROUND_OFF * (weights * force).max()):
            return weights
    raise DataError(f"the weights do not converge in {WEIGHT_ITERATIONS} iterations: use ols")


def least_squares_weights(problem: FitProblem, prior: FloatArray | None = None) -> FloatArray:
    """The converged weights (dof,) of least squares with the rows of a prior."""

    def fitted(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        values, R = solved(problem, weights, prior)
        return values, leverages(problem, weights, R)

    return converged_weights(problem, fitted)


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
        degrees_of_freedom=np.array(float(problem.freedom)),
        quality=fit_quality(problem, values),
        weights=weights,
    )


def require_excitation(problem: FitProblem, R: FloatArray) -> None:
    """Refuse a triangular factor (n, n) whose scaled columns are linearly dependent."""
    labels, norms = problem.parameters.labels, np.linalg.norm(R, axis=0)
    if not (norms > 0).all():
        raise RankError(f"the data do not excite {labels[int(norms.argmin())]} at all")
    _, values, right = np.linalg.svd(R / norms)
    if values[-1] >= LEAST_EXCITATION * values[0]:
        return
    # Round-off turns the single directions where there are several: only their span is named.
    part = np.linalg.norm(right[values < LEAST_EXCITATION * values[0]], axis=0)
    involved = np.flatnonzero(part > INVOLVED * part.max())
    raise RankError(
        f"the data do not excite a combination of {', '.join(labels[j] for j in involved)}: "
        f"relative singular value {values[-1] / values[0]:.1e} (least {LEAST_EXCITATION:g}); fit "
        "base parameters, or use a motion that excites them"
    )


def excited_rank(R: FloatArray) -> int:
    """Number of combinations of parameters that the data of a triangular factor (n, n) excite."""
    norms = np.linalg.norm(R, axis=0)
    if not norms.any():
        return 0
    values = np.linalg.svd(R[:, norms > 0] / norms[norms > 0], compute_uv=False)
    return int((values >= LEAST_EXCITATION * values[0]).sum())
