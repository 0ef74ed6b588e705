"""Closing the loops from any configuration by damped Gauss-Newton steps [Nocedal2006, ch. 10].

All starts advance together, each with its own damping; every linear solve is batched.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.frames import integrate
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.measured import scaled_constraint
from loopid.kinematics.scaling import coordinate_scales
from loopid.mechanism import Mechanism

STEPS = 100
POLISH_STEPS = 12
LONGEST_STEP = 0.3  # rad or characteristic lengths
FIRST_DAMPING = 0.1  # characteristic lengths, the unit of the scaled Jacobian
CONTINUATION_STEPS = 20
# In characteristic lengths: the error from which on plain steps do better, and the damping at
# which nothing helps.
DONE = 1e-9
STUCK = 1e3
WORTHWHILE = 0.999  # a step that leaves more of the error is damped more


def close_loops(
    mechanism: Mechanism, configurations: FloatArray, movable: IntArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Move coordinates until the loops close, as far as they do.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), starts.
    movable : IntArray, optional
        Velocity indices of the coordinates that may move; all by default.

    Returns
    -------
    configurations : FloatArray
        (N, nq), inside the limits where that closes them.
    gap : FloatArray
        (N,), largest closure residual left, in m.
    """
    free = np.arange(mechanism.model.nv) if movable is None else movable
    open_by = np.zeros((len(configurations), mechanism.rows))
    q = _descend(mechanism, configurations, free, open_by)
    return polish(mechanism, q, free)


def close_by_continuation(
    mechanism: Mechanism, configurations: FloatArray, movable: IntArray
) -> tuple[FloatArray, FloatArray]:
    """As ``close_loops``, shrinking the residual in equal parts so as to stay near the start."""
    q = configurations
    first, _ = scaled_constraint(mechanism, q)
    for left in np.linspace(1.0, 0.0, CONTINUATION_STEPS + 1)[1:]:
        q = _descend(mechanism, q, movable, left * first)
    return polish(mechanism, q, movable)


def constraint_gap(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Largest closure residual (N,) in m."""
    residual, _ = scaled_constraint(mechanism, configurations)
    return np.asarray(np.abs(residual).max(axis=1, initial=0.0), dtype=np.float64)


def _descend(
    mechanism: Mechanism, q: FloatArray, movable: IntArray, goal: FloatArray
) -> FloatArray:
    """Levenberg-Marquardt steps towards a residual, inside the limits."""
    q, length = q.copy(), mechanism.length
    damping = np.full(len(q), FIRST_DAMPING * length)
    residual, jacobian = _open_by(mechanism, q, goal)
    error = np.linalg.norm(residual, axis=1)
    for _ in range(STEPS if len(movable) else 0):
        k = np.flatnonzero((error > DONE * length) & (damping < STUCK * length))
        if not len(k):
            break
        tried = _tried(mechanism, q[k], movable, jacobian[k], residual[k], damping[k])
        there, jacobian_there = _open_by(mechanism, tried, goal[k])
        error_there = np.linalg.norm(there, axis=1)
        damping[k] *= np.where(error_there < WORTHWHILE * error[k], 0.3, 4.0)
        better = error_there < error[k]
        q[k[better]], residual[k[better]] = tried[better], there[better]
        jacobian[k[better]], error[k[better]] = jacobian_there[better], error_there[better]
    return q


def _open_by(
    mechanism: Mechanism, q: FloatArray, goal: FloatArray
) -> tuple[FloatArray, FloatArray]:
    residual, jacobian = scaled_constraint(mechanism, q)
    return residual - goal, jacobian


def _tried(
    mechanism: Mechanism,
    q: FloatArray,
    movable: IntArray,
    jacobian: FloatArray,
    open_by: FloatArray,
    damping: FloatArray,
) -> FloatArray:
    """Configurations after a damped step, in which joints that their limits stop take no part."""
    lower, upper = _limits_of(mechanism, movable)
    columns = jacobian[:, :, movable]
    moved = _moved(mechanism, q, movable, _damped_step(columns, open_by, damping))
    beyond = ((q <= lower) & (moved < lower)) | ((q >= upper) & (moved > upper))
    if beyond.any():
        stopped = beyond[:, mechanism.first_positions[movable]]
        step = _damped_step(columns * ~stopped[:, None], open_by, damping)
        moved = _moved(mechanism, q, movable, step)
    return np.clip(moved, lower, upper)


def _damped_step(columns: FloatArray, open_by: FloatArray, damping: FloatArray) -> FloatArray:
    factors = Factorisation.of(columns)
    return np.asarray(-factors.solve(open_by[:, :, None], damping)[:, :, 0], dtype=np.float64)


def polish(mechanism: Mechanism, q: FloatArray, movable: IntArray) -> tuple[FloatArray, FloatArray]:
    """Plain Gauss-Newton steps to round-off, kept where they shrink the gap; as ``close_loops``."""
    gap = constraint_gap(mechanism, q)
    for _ in range(POLISH_STEPS if len(movable) else 0):
        residual, jacobian = scaled_constraint(mechanism, q)
        factors = Factorisation.of(jacobian[:, :, movable])
        step = -factors.solve(residual[:, :, None])[:, :, 0]
        moved = _moved(mechanism, q, movable, step)
        there = constraint_gap(mechanism, moved)
        better = there < gap
        if not better.any():
            break
        q, gap = np.where(better[:, None], moved, q), np.where(better, there, gap)
    return q, gap


def _moved(mechanism: Mechanism, q: FloatArray, movable: IntArray, step: FloatArray) -> FloatArray:
    """Configurations moved by scaled steps (N, u) of limited length."""
    longest = np.abs(step).max(axis=1, initial=0.0)
    step = step * np.minimum(1.0, LONGEST_STEP / np.maximum(longest, 1e-300))[:, None]
    tangent = np.zeros((len(q), mechanism.model.nv))
    tangent[:, movable] = step * coordinate_scales(mechanism)[movable]
    return integrate(mechanism, q, tangent)


def _limits_of(mechanism: Mechanism, movable: IntArray) -> tuple[FloatArray, FloatArray]:
    """Position limits (nq,) of the joints that may move, none for the others."""
    moves = np.zeros(mechanism.model.nq, dtype=bool)
    moves[mechanism.first_positions[movable]] = True
    lower, upper = mechanism.position_limits
    return np.where(moves, lower, -np.inf), np.where(moves, upper, np.inf)
