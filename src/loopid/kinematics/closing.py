"""Closing the loops from any configuration by damped Gauss-Newton steps [Nocedal2006, ch. 10].

All starts advance together, each with its own damping; every linear solve is batched.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.kinematics.equations import scaled_constraint, scaled_residual
from loopid.kinematics.frames import integrate
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.newton import SHORT
from loopid.kinematics.scaling import coordinate_scales
from loopid.robot import Mechanism

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


class _Points:
    """Configurations (N, nq) with their scaled residual and Jacobian, found once each."""

    def __init__(self, mechanism: Mechanism, q: FloatArray) -> None:
        self.q = q.copy()
        self.residual, self.jacobian = scaled_constraint(mechanism, q)

    @property
    def gap(self) -> FloatArray:
        """Largest residual (N,) in m."""
        return np.asarray(np.abs(self.residual).max(axis=1, initial=0.0), dtype=np.float64)

    def replace(self, rows: IntArray, others: _Points, better: BoolArray) -> None:
        """Put in the better ones of other points, one a row."""
        k = rows[better]
        self.q[k], self.residual[k] = others.q[better], others.residual[better]
        self.jacobian[k] = others.jacobian[better]


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
    points = _Points(mechanism, configurations)
    _descend(mechanism, points, free, np.zeros_like(points.residual))
    return _polished(mechanism, points, free)


def close_by_continuation(
    mechanism: Mechanism, configurations: FloatArray, movable: IntArray
) -> tuple[FloatArray, FloatArray]:
    """As ``close_loops``, shrinking the residual in equal parts so as to stay near the start."""
    points = _Points(mechanism, configurations)
    first = points.residual.copy()
    for left in np.linspace(1.0, 0.0, CONTINUATION_STEPS + 1)[1:]:
        _descend(mechanism, points, movable, left * first)
    return _polished(mechanism, points, movable)


def polish(mechanism: Mechanism, q: FloatArray, movable: IntArray) -> tuple[FloatArray, FloatArray]:
    """Plain Gauss-Newton steps to round-off, kept where they shrink the gap; as ``close_loops``."""
    return _polished(mechanism, _Points(mechanism, q), movable)


def constraint_gap(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Largest closure residual (N,) in m."""
    residual = scaled_residual(mechanism, configurations)
    return np.asarray(np.abs(residual).max(axis=1, initial=0.0), dtype=np.float64)


def _descend(mechanism: Mechanism, at: _Points, movable: IntArray, goal: FloatArray) -> None:
    """Levenberg-Marquardt steps towards a residual, inside the limits."""
    length = mechanism.length
    damping = np.full(len(at.q), FIRST_DAMPING * length)
    error = np.linalg.norm(at.residual - goal, axis=1)
    for _ in range(STEPS if len(movable) else 0):
        k = np.flatnonzero((error > DONE * length) & (damping < STUCK * length))
        if not len(k):
            break
        open_by = at.residual[k] - goal[k]
        tried = _tried(mechanism, at.q[k], movable, at.jacobian[k], open_by, damping[k])
        there = _Points(mechanism, tried)
        error_there = np.linalg.norm(there.residual - goal[k], axis=1)
        damping[k] *= np.where(error_there < WORTHWHILE * error[k], 0.3, 4.0)
        better = error_there < error[k]
        at.replace(k, there, better)
        error[k[better]] = error_there[better]


def _polished(
    mechanism: Mechanism, at: _Points, movable: IntArray
) -> tuple[FloatArray, FloatArray]:
    k = np.arange(len(at.q))
    for _ in range(POLISH_STEPS if len(movable) else 0):
        factors = Factorisation.of(at.jacobian[k][:, :, movable])
        step = -factors.solve(at.residual[k][:, :, None])[:, :, 0]
        there = _Points(mechanism, _moved(mechanism, at.q[k], movable, step))
        better = there.gap < at.gap[k]
        at.replace(k, there, better)
        # A step that short leaves an error of round-off.
        k = k[better & (np.abs(step).max(axis=1, initial=0.0) > SHORT)]
        if not len(k):
            break
    return at.q, at.gap


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
