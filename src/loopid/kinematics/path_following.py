"""Following a branch of closed configurations to measured coordinates.

The measured coordinates move from those of the start to the targets along a straight line, in
steps whose length adapts so that Newton's method contracts at once and the Jacobian keeps its
orientation: the solution then stays on the assembly branch of the start [Allgower2003]. All
samples advance together, each with its own step; every linear solve is batched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.kinematics.frames import integrate
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.measured import MeasuredCoordinates

CLOSURE_TOLERANCE = 1e-10  # m; what an assembled configuration must reach
# Newton steps, in rad or characteristic lengths: below ROUND_OFF there is nothing left to gain,
# below STAGNATION a step that no longer contracts is round-off in an ill-conditioned solve.
ROUND_OFF = 1e-15
STAGNATION = 1e-10
NEWTON_STEPS = 12
# A step along the path is accepted when each Newton step is at most this fraction of the last,
# and the first one at most this many rad (or characteristic lengths).
CONTRACTION = 0.2
LONGEST_STEP = 0.4
SHORTEST_PATH_STEP = 2.0**-12


@dataclass(frozen=True)
class Assembly:
    """Assembled configurations.

    Attributes
    ----------
    configurations : FloatArray
        (N, nq); rows that could not be assembled hold NaN.
    residual : FloatArray
        (N,), largest closure residual in m.
    assembled : BoolArray
        (N,), whether the loops close to the tolerance on the start's branch.
    """

    configurations: FloatArray
    residual: FloatArray
    assembled: BoolArray


def follow_path(
    measured: MeasuredCoordinates,
    q: FloatArray,
    targets: FloatArray,
    tolerance: float,
    shortest_step: float,
) -> Assembly:
    """Move all samples along their straight lines to the targets."""
    origin = measured.read(q)
    way = measured.difference(origin, targets)
    _, jacobian = measured.equations(q, origin)
    done, step = np.zeros(len(q)), np.ones(len(q))
    active = np.ones(len(q), dtype=bool)
    while active.any():
        k = np.flatnonzero(active)
        ahead = np.minimum(done[k] + step[k], 1.0)
        goal = origin[k] + ahead[:, None] * way[k]
        moved, accepted = _newton(measured, q[k], goal)
        _, jacobian_there = measured.equations(moved, goal)
        accepted &= _same_side(jacobian[k], jacobian_there)
        there = k[accepted]
        q[there], done[there] = moved[accepted], ahead[accepted]
        jacobian[there] = jacobian_there[accepted]
        step[k] = np.where(accepted, 2.0 * step[k], 0.5 * step[k])
        active = (done < 1.0) & (step >= shortest_step)
    q = measured.write(q, targets)
    residual = measured.closure_gap(q, targets)
    assembled = (done >= 1.0) & (residual <= max(tolerance, 2.0 * measured.mechanism.closure_gap))
    return Assembly(np.where(assembled[:, None], q, np.nan), residual, assembled)


def _newton(
    measured: MeasuredCoordinates, q: FloatArray, targets: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Newton's method towards close targets; accepted where it contracts from the first step on.

    Where Newton's method contracts this much, Kantorovich's theorem lets one expect that the root
    is unique around the start, hence the one that continues its branch.
    """
    q = measured.write(q, targets)
    accepted, running = np.ones((2, len(q)), dtype=bool)
    longest = np.full(len(q), LONGEST_STEP)
    for _ in range(NEWTON_STEPS):
        k = np.flatnonzero(running)
        step, length = _newton_step(measured, q[k], targets[k])
        q[k] = integrate(measured.mechanism, q[k], step)
        contracts = length <= longest[k]
        accepted[k] = contracts | (length <= STAGNATION)
        running[k] = contracts & (length > ROUND_OFF)
        longest[k] = CONTRACTION * length
        if not running.any():
            break
    return q, accepted & ~running


def _same_side(before: FloatArray, after: FloatArray) -> BoolArray:
    """Whether no singularity lies between two Jacobians of the unknown coordinates.

    det(JᵀJ') of close Jacobians is positive, and changes its sign with that of a square J'.
    """
    sign, _ = np.linalg.slogdet(before.transpose(0, 2, 1) @ after)
    return np.asarray(sign > 0, dtype=bool)


def _newton_step(
    measured: MeasuredCoordinates, q: FloatArray, targets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    residual, jacobian = measured.equations(q, targets)
    scaled = -Factorisation.of(jacobian).solve(residual[:, :, None])[:, :, 0]
    length = np.abs(scaled).max(axis=1, initial=0.0)
    return measured.tangent(scaled), length
