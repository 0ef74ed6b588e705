"""Steps of Newton's method from linear equations, and the sides of singularities they are on."""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.kinematics.dependent import FEW, DependentColumns
from loopid.kinematics.elimination import Elimination
from loopid.kinematics.linear import Factorisation

# The first step of a correction may have this many rad (or characteristic lengths).
LONGEST_STEP = 0.4
# Singularity measure above which a common order of pivots is good enough.
REGULAR = 1e-6


def solve(
    jacobian: FloatArray, right_hand_sides: FloatArray, elimination: Elimination | None = None
) -> tuple[FloatArray, FloatArray]:
    """Least-squares solutions (N, u, c) of systems (N, m, u) with (N, m, c), and orientations."""
    if elimination is None or len(jacobian) < FEW:
        return _solved_by_lu(jacobian, right_hand_sides), orientation(jacobian)
    columns = DependentColumns.of(np.moveaxis(jacobian, 0, 2), elimination, REGULAR)
    solution = columns.solve(np.moveaxis(right_hand_sides, 0, 2))
    signs = columns.signs.copy()
    signs[columns.doubtful] = orientation(jacobian[columns.doubtful])
    return np.moveaxis(solution, 2, 0), signs


def _solved_by_lu(jacobian: FloatArray, right_hand_sides: FloatArray) -> FloatArray:
    """Least-squares solutions.

    By LU factors; where the first column's solution is no acceptable step, what is singular may
    be the reason, and the rank is counted.
    """
    matrix, right = jacobian, right_hand_sides
    if jacobian.shape[1] != jacobian.shape[2]:
        transposed = jacobian.transpose(0, 2, 1)
        matrix, right = transposed @ jacobian, transposed @ right_hand_sides
    try:
        solution = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return Factorisation.of(jacobian).solve(right_hand_sides)
    suspect = ~(np.abs(solution[:, :, 0]).max(axis=1, initial=0.0) <= LONGEST_STEP)
    if suspect.any():
        factors = Factorisation.of(jacobian[suspect])
        solution[suspect] = factors.solve(right_hand_sides[suspect])
    return np.asarray(solution, dtype=np.float64)


def same_side(before: FloatArray, after: FloatArray) -> BoolArray:
    """Whether no singularity lies between two Jacobians of the unknown coordinates.

    det(JᵀJ') of close Jacobians is positive, and changes its sign with that of a square J'.
    """
    sign, _ = np.linalg.slogdet(before.transpose(0, 2, 1) @ after)
    return np.asarray(sign > 0, dtype=bool)


def orientation(jacobian: FloatArray) -> FloatArray:
    """Signs (N,) of the determinants of square Jacobians; nothing is known of others' (zero)."""
    if jacobian.shape[1] != jacobian.shape[2]:
        return np.zeros(len(jacobian))
    return np.asarray(np.linalg.slogdet(jacobian)[0], dtype=np.float64)
