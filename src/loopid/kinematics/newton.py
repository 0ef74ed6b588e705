"""Newton's method towards close measured coordinates, batched over samples.

Steps of the unknown coordinates are in common units (rad or characteristic lengths).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.kinematics.frames import integrate
from loopid.kinematics.measured import MeasuredCoordinates
from loopid.kinematics.step_solves import LONGEST_STEP, solve

NEWTON_STEPS = 12
# A Newton step this short, the root of the round-off, leaves an error of round-off.
SHORT = 1e-8
# A correction is accepted when each Newton step is at most this fraction of the last.
CONTRACTION = 0.2


class NewtonStep(NamedTuple):
    """Configurations (N, nq) after one step, its length (N,), and what it was found from.

    The Jacobian (N, m, u) is by the unknown coordinates; the tangent (N, u, k) holds the steps of
    these that go with k directions of the measured ones. The sign (N,) is that of the Jacobian's
    determinant, 0 where it is not square.
    """

    configurations: FloatArray
    length: FloatArray
    jacobian: FloatArray
    tangent: FloatArray
    sign: FloatArray


class Correction(NamedTuple):
    """Configurations (N, nq) after Newton's method, and where (N,) it contracted at once.

    Jacobian (N, m, u), tangent (N, u, k) and sign (N,) are those of its last step, which is short.
    """

    configurations: FloatArray
    accepted: BoolArray
    jacobian: FloatArray
    tangent: FloatArray
    sign: FloatArray


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
        pull = np.concatenate([pull, np.einsum("nij,njk->nik", at.known, directions)], axis=2)
    solution, sign = solve(at.unknown, pull, measured.elimination)
    steps = -solution
    length = np.abs(steps[:, :, 0]).max(axis=1, initial=0.0)
    moved = integrate(measured.mechanism, q, measured.tangent(steps[:, :, 0]))
    return NewtonStep(moved, length, at.unknown, steps[:, :, 1:], sign)


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
    found = Correction(step.configurations, accepted, step.jacobian, step.tangent, step.sign)
    k, length = np.arange(len(q)), step.length
    for _ in range(NEWTON_STEPS - 1):
        going = found.accepted[k] & (length > SHORT)
        k, longest = k[going], CONTRACTION * length[going]
        if not len(k):
            return found
        step = newton_step(measured, found.configurations[k], values[k], directions[k])
        length = step.length
        found.configurations[k], found.accepted[k] = step.configurations, contracts(length, longest)
        found.jacobian[k], found.tangent[k], found.sign[k] = step.jacobian, step.tangent, step.sign
    found.accepted[k[length > SHORT]] = False
    return found


def contracts(length: FloatArray, longest: FloatArray) -> BoolArray:
    """Whether Newton steps are as short as they must be, or have nothing left to correct."""
    return np.asarray((length <= longest) | (length <= SHORT), dtype=bool)
