"""Newton's method towards close measured coordinates, batched over samples.

Steps of the unknown coordinates are in common units (rad or characteristic lengths).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.kinematics.frames import integrate
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.measured import MeasuredCoordinates

NEWTON_STEPS = 12
# A Newton step this short, the root of the round-off, leaves an error of round-off.
SHORT = 1e-8
# A correction is accepted when each Newton step is at most this fraction of the last, and the
# first one at most this many rad (or characteristic lengths).
CONTRACTION = 0.2
LONGEST_STEP = 0.4


class NewtonStep(NamedTuple):
    """Configurations (N, nq) after one step, its length (N,), and what it was found from.

    The Jacobian (N, m, u) is by the unknown coordinates; the tangent (N, u, k) holds the steps of
    these that go with k directions of the measured ones.
    """

    configurations: FloatArray
    length: FloatArray
    jacobian: FloatArray
    tangent: FloatArray


class Correction(NamedTuple):
    """Configurations (N, nq) after Newton's method, and where (N,) it contracted at once.

    Jacobian (N, m, u) and tangent (N, u, k) are those of its last step, which is short.
    """

    configurations: FloatArray
    accepted: BoolArray
    jacobian: FloatArray
    tangent: FloatArray


def newton_step(
    measured: MeasuredCoordinates,
    q: FloatArray,
    values: FloatArray,
    directions: FloatArray | None = None,
) -> NewtonStep:
    """Move configurations (N, nq) towards measured values (N, c).

    Parameters
    ----------
    directions : FloatArray, optional
        (N, c, k), steps of the measured coordinates for which tangents are wanted.
    """
    at = measured.linearise(q, values)
    pull = at.residual[:, :, None]
    if directions is not None:
        pull = np.concatenate([pull, at.known @ directions], axis=2)
    steps = -solve(at.unknown, pull)
    length = np.abs(steps[:, :, 0]).max(axis=1, initial=0.0)
    moved = integrate(measured.mechanism, q, measured.tangent(steps[:, :, 0]))
    return NewtonStep(moved, length, at.unknown, steps[:, :, 1:])


def correct(
    measured: MeasuredCoordinates, q: FloatArray, values: FloatArray, directions: FloatArray
) -> Correction:
    """Correct configurations (N, nq) until they have the measured values (N, c).

    Where Newton's method contracts this much, Kantorovich's theorem lets one expect that the root
    is unique around the start, hence the one that continues its branch.

    Parameters
    ----------
    directions : FloatArray
        (N, c, k), as in ``newton_step``.
    """
    step = newton_step(measured, measured.write(q, values), values, directions)
    accepted = step.length <= LONGEST_STEP
    found = Correction(step.configurations, accepted, step.jacobian, step.tangent)
    k, length = np.arange(len(q)), step.length
    for _ in range(NEWTON_STEPS - 1):
        going = found.accepted[k] & (length > SHORT)
        k, longest = k[going], CONTRACTION * length[going]
        if not len(k):
            return found
        q, length, jacobian, tangent = newton_step(
            measured, found.configurations[k], values[k], directions[k]
        )
        found.configurations[k], found.accepted[k] = q, contracts(length, longest)
        found.jacobian[k], found.tangent[k] = jacobian, tangent
    found.accepted[k[length > SHORT]] = False
    return found


def contracts(length: FloatArray, longest: FloatArray) -> BoolArray:
    """Whether Newton steps are as short as they must be, or have nothing left to correct."""
    return np.asarray((length <= longest) | (length <= SHORT), dtype=bool)


def solve(jacobian: FloatArray, right_hand_sides: FloatArray) -> FloatArray:
    """Least-squares solutions (N, u, c) of systems (N, m, u) with (N, m, c).

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
