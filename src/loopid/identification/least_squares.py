"""Least squares on triangular factors, which all estimators build on.

Rows of each actuator are weighted by one over the deviation of its errors; weights that follow from
the residuals that they lead to are found by iteration [Gautier1997].
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from loopid.arguments import FloatArray
from loopid.errors import DataError, RankError
from loopid.identification.problem import ROUND_OFF, FitProblem
from loopid.identification.result import FitResult, fit_quality
from loopid.records import record

# Smallest over largest singular value, of columns scaled to unit length, that data must excite.
LEAST_EXCITATION = 1e-8
# Part in the unidentifiable directions, relative to the largest, above which a parameter is named.
INVOLVED = 0.1
# Round-off of the forces, relative to them: all that is known of errors that are as small.
WEIGHT_ROUND_OFF = 1e-13


@record(checked=True)
class Convergence:
    """When weights have converged.

    Attributes
    ----------
    iterations : int
        At most.
    tolerance : float
        Relative change of the weights that ends the iteration.
    """

    iterations: int = 500
    tolerance: float = 1e-10


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
            f"actuator {name} is fitted without error: its weight is undefined; use ols",
            actuator=name,
        )
    return np.where(present, 1.0 / np.where(present, deviations, 1.0), 0.0)


def converged_weights(
    problem: FitProblem,
    fitted: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    convergence: Convergence = Convergence(),
) -> FloatArray:
    """Weights (dof,) that are the inverse deviations of the residuals that they lead to.

    Of given weights (dof,), ``fitted`` makes the values (n,) and leverages (dof,) of the fit.
    """
    weights = equal_weights(problem)
    present, force = weights > 0, problem.force_rms
    for _ in range(convergence.iterations):
        values, leverage = fitted(weights)
        last, squares = weights, problem.residual_squares(values)
        weights = inverse_deviations(problem, squares, problem.samples - leverage)
        change = np.abs(weights[present] / last[present] - 1.0).max(initial=0.0)
        if change <= max(convergence.tolerance, WEIGHT_ROUND_OFF * (weights * force).max()):
            return weights
    raise DataError(
        f"the weights do not converge in {convergence.iterations} iterations: use ols",
        iterations=convergence.iterations,
    )


def least_squares_weights(
    problem: FitProblem,
    prior: FloatArray | None = None,
    convergence: Convergence = Convergence(),
) -> FloatArray:
    """The converged weights (dof,) of least squares with the rows of a prior."""

    def fitted(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        values, R = solved(problem, weights, prior)
        return values, leverages(problem, weights, R)

    return converged_weights(problem, fitted, convergence)


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
        name = labels[int(norms.argmin())]
        raise RankError(f"the data do not excite {name} at all", parameters=(name,))
    _, values, right = np.linalg.svd(R / norms)
    if values[-1] >= LEAST_EXCITATION * values[0]:
        return
    # Round-off turns the single directions where there are several: only their span is named.
    part = np.linalg.norm(right[values < LEAST_EXCITATION * values[0]], axis=0)
    names = tuple(labels[j] for j in np.flatnonzero(part > INVOLVED * part.max()))
    raise RankError(
        f"the data do not excite a combination of {', '.join(names)}: "
        f"relative singular value {values[-1] / values[0]:.1e} (least {LEAST_EXCITATION:g}); fit "
        "base parameters, or use a motion that excites them",
        parameters=names,
        singular_value=float(values[-1] / values[0]),
        tolerance=LEAST_EXCITATION,
    )


def excited_rank(R: FloatArray) -> int:
    """Number of combinations of parameters that the data of a triangular factor (n, n) excite."""
    norms = np.linalg.norm(R, axis=0)
    if not norms.any():
        return 0
    values = np.linalg.svd(R[:, norms > 0] / norms[norms > 0], compute_uv=False)
    return int((values >= LEAST_EXCITATION * values[0]).sum())
