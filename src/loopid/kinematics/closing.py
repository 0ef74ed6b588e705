"""Closing the loops from any configuration by damped Gauss-Newton steps [Nocedal2006, ch. 10].

All starts advance together, each with its own damping; every linear solve is batched.
"""

from __future__ import annotations

import numpy as np

from loopid.arguments import (
    BoolArray,
    FloatArray,
    IntArray,
    random_generator,
)
from loopid.kinematics.constraint import (
    Constraint,
    largest_residual,
)
from loopid.kinematics.linear import (
    Factorisation,
    null_space,
)
from loopid.kinematics.poses import integrate
from loopid.kinematics.projection import (
    partition,
    velocity_map,
)
from loopid.robot.mechanism import Mechanism

# Steps and damping are in rad or characteristic lengths, as the scaled Jacobian has them.
STEPS = 100
POLISH_STEPS = 12
SHORT = 1e-8  # a plain step this short leaves an error of round-off
LONGEST_STEP = 0.3
FIRST_DAMPING = 0.1
# Below this damping steps zigzag between far starts and take long to be damped again.
LEAST_DAMPING = 1e-3
CONTINUATION_STEPS = 20
DONE = 1e-9  # the error from which on plain steps do better
STUCK = 1e3  # the damping at which nothing helps
WORTHWHILE = 0.999  # a step that leaves more of the error is damped more
# Random walks to configurations nearby, their steps, and the residual that counts as closed.
WALKS = 8
WALK_STEPS = 3
WALK_STEP = 0.1
CLOSED = 1e-7


class _Points:
    """Configurations (N, nq) with their scaled residual and Jacobian, found once each."""

    def __init__(self, mechanism: Mechanism, q: FloatArray) -> None:
        self.q = q.copy()
        self.residual, self.jacobian = Constraint(mechanism, q).scaled()

    @property
    def largest(self) -> FloatArray:
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
    """Move coordinates, by velocity indices, until the loops close, as far as they do.

    From starts (N, nq) to configurations (N, nq), inside the limits where that closes them, and the
    largest closure residual (N,) that is left, in m.
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


def displaced(
    mechanism: Mechanism, configurations: FloatArray, steps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move closed configurations (N, nq) by steps (N, dof) of the independent coordinates.

    The way for coordinates that have no value of their own, such as the spin of a rod in a ball
    joint: u̇ is integrated along G, and Newton steps of the others keep the loops closed. Gives
    configurations (N, nq) and the residual (N,) left, in m: large where the way met a singularity.
    """
    chosen, dependent = partition(mechanism)
    longest = float(np.abs(steps / mechanism.coordinate_scales[chosen]).max(initial=0.0))
    parts = int(np.ceil(longest / LONGEST_STEP))
    q, residual = configurations, largest_residual(mechanism, configurations)
    for _ in range(parts):
        G, _ = velocity_map(mechanism, Constraint(mechanism, q).scaled()[1], chosen, dependent)
        q = integrate(mechanism, q, np.einsum("nij,nj->ni", G, steps / parts))
        q, residual = _polished(mechanism, _Points(mechanism, q), dependent)
    return q, residual


def nearby_configurations(mechanism: Mechanism, configuration: FloatArray) -> FloatArray:
    """A closed configuration (nq,), then those of ``WALKS`` from it that stay closed (n, nq)."""
    if mechanism.rows == 0:
        return configuration[None]  # a tree moves alike everywhere
    nv, generator = mechanism.model.nv, random_generator(0, stream=3)
    places = mechanism.draw_places(np.arange(nv))
    q = np.repeat(configuration[None], WALKS, axis=0)
    for _ in range(WALK_STEPS):
        _, jacobian = Constraint(mechanism, q).scaled()
        steps = generator.normal(size=(WALKS, nv))[:, places]
        for k in range(WALKS):
            basis = null_space(jacobian[k], mechanism.closure_rank_tolerance)
            direction = basis @ (basis.T @ steps[k])
            steps[k] = WALK_STEP * direction / max(np.abs(direction).max(initial=0.0), 1e-300)
        start = integrate(mechanism, q, steps * mechanism.coordinate_scales)
        q, residual = close_loops(mechanism, start)
    near = max(CLOSED * mechanism.length, 2.0 * mechanism.closure_residual)
    return np.concatenate([configuration[None], q[residual <= near]])


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
        damping = np.maximum(damping, LEAST_DAMPING * length)
        better = error_there < error[k]
        at.replace(k, there, better)
        error[k[better]] = error_there[better]


def _polished(
    mechanism: Mechanism, at: _Points, movable: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Plain Gauss-Newton steps to round-off, kept where they shrink the residual."""
    k = np.arange(len(at.q))
    for _ in range(POLISH_STEPS if len(movable) else 0):
        columns = at.jacobian[k][:, :, movable]
        factors = Factorisation.of(columns, mechanism.closure_rank_tolerance)
        step = -factors.solve(at.residual[k][:, :, None])[:, :, 0]
        there = _Points(mechanism, _moved(mechanism, at.q[k], movable, step))
        better = there.largest < at.largest[k]
        at.replace(k, there, better)
        k = k[better & (np.abs(step).max(axis=1, initial=0.0) > SHORT)]
        if not len(k):
            break
    return at.q, at.largest


def _tried(
    mechanism: Mechanism,
    q: FloatArray,
    movable: IntArray,
    jacobian: FloatArray,
    open_by: FloatArray,
    damping: FloatArray,
) -> FloatArray:
    """Configurations after a damped step, in which joints that their limits stop take no part."""
    moves = np.zeros(mechanism.model.nq, dtype=bool)
    moves[mechanism.first_positions[movable]] = True
    lower, upper = mechanism.position_limits
    lower, upper = np.where(moves, lower, -np.inf), np.where(moves, upper, np.inf)
    columns = jacobian[:, :, movable]

    def moved(columns: FloatArray) -> FloatArray:
        # Normal equations would lift round-off, and let processors find other poses.
        factors = Factorisation.of(columns, mechanism.closure_rank_tolerance)
        step = -factors.solve(open_by[:, :, None], damping)[:, :, 0]
        return _moved(mechanism, q, movable, step)

    ahead = moved(columns)
    beyond = ((q <= lower) & (ahead < lower)) | ((q >= upper) & (ahead > upper))
    if beyond.any():
        ahead = moved(columns * ~beyond[:, None, mechanism.first_positions[movable]])
    return np.clip(ahead, lower, upper)


def _moved(mechanism: Mechanism, q: FloatArray, movable: IntArray, step: FloatArray) -> FloatArray:
    """Configurations moved by scaled steps (N, u) of limited length."""
    longest = np.abs(step).max(axis=1, initial=0.0)
    step = step * np.minimum(1.0, LONGEST_STEP / np.maximum(longest, 1e-300))[:, None]
    tangent = np.zeros((len(q), mechanism.model.nv))
    tangent[:, movable] = step * mechanism.coordinate_scales[movable]
    return integrate(mechanism, q, tangent)
