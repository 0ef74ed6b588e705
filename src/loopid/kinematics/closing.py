"""Closing the loops from any configuration by damped Gauss-Newton steps [Nocedal2006, ch. 10].

All starts advance together, each with its own damping; every linear solve is batched.
"""

from __future__ import annotations

import numpy as np

from loopid.arguments import BoolArray, FloatArray, IntArray, random_generator
from loopid.kinematics.constraint import Constraint, largest_residual
from loopid.kinematics.linear import Factorisation, null_space
from loopid.kinematics.poses import integrate
from loopid.kinematics.projection import partition, velocity_map
from loopid.records import record
from loopid.robot.mechanism import Mechanism


@record(checked=True)
class ClosingOptions:
    """How loops are closed.

    Steps and damping are in rad or characteristic lengths, as the scaled Jacobian has them; they
    are so short because far starts are to reach the nearest closed configuration.
    """

    steps: int = 100  # damped ones, at most
    longest_step: float = 0.3
    first_damping: float = 0.1
    # Below this damping steps zigzag between far starts and take long to be damped again
    least_damping: float = 1e-3
    stuck: float = 1e3  # the damping at which nothing helps
    worthwhile: float = 0.999  # a step that leaves more of the error is damped more
    done: float = 1e-9  # the error, in characteristic lengths, from which on plain steps do better
    polish_steps: int = 12  # plain ones, at most
    short: float = 1e-8  # a plain step this short leaves an error of round-off
    continuation_steps: int = 20  # equal parts that the residual shrinks by


@record(checked=True)
class WalkOptions:
    """Random walks to closed configurations nearby."""

    walks: int = 8
    steps: int = 3
    step: float = 0.1  # rad or characteristic lengths
    closed: float = 1e-7  # the residual that counts as closed, in characteristic lengths


CLOSING, WALKS = ClosingOptions(), WalkOptions()


class _Points:
    """Configurations (N, nq) with their scaled residual and Jacobian, found once each."""

    def __init__(self, mechanism: Mechanism, q: FloatArray) -> None:
        self.mechanism, self.q = mechanism, q.copy()
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
    mechanism: Mechanism,
    configurations: FloatArray,
    movable: IntArray | None = None,
    *,
    options: ClosingOptions = CLOSING,
) -> tuple[FloatArray, FloatArray]:
    """Move coordinates, by velocity indices, until the loops close, as far as they do.

    From starts (N, nq) to configurations (N, nq), inside the limits where that closes them, and the
    largest closure residual (N,) that is left, in m.
    """
    free = np.arange(mechanism.model.nv) if movable is None else movable
    points = _Points(mechanism, configurations)
    _descend(points, free, np.zeros_like(points.residual), options)
    return _polished(points, free, options)


def close_by_continuation(
    mechanism: Mechanism,
    configurations: FloatArray,
    movable: IntArray,
    *,
    options: ClosingOptions = CLOSING,
) -> tuple[FloatArray, FloatArray]:
    """As ``close_loops``, shrinking the residual in equal parts so as to stay near the start."""
    points = _Points(mechanism, configurations)
    first = points.residual.copy()
    for left in np.linspace(1.0, 0.0, options.continuation_steps + 1)[1:]:
        _descend(points, movable, left * first, options)
    return _polished(points, movable, options)


def displaced(
    mechanism: Mechanism,
    configurations: FloatArray,
    steps: FloatArray,
    *,
    options: ClosingOptions = CLOSING,
) -> tuple[FloatArray, FloatArray]:
    """Move closed configurations (N, nq) by steps (N, dof) of the independent coordinates.

    The way for coordinates that have no value of their own, such as the spin of a rod in a ball
    joint: u̇ is integrated along G, and Newton steps of the others keep the loops closed. Gives
    configurations (N, nq) and the residual (N,) left, in m: large where the way met a singularity.
    """
    chosen, dependent = partition(mechanism)
    longest = float(np.abs(steps / mechanism.coordinate_scales[chosen]).max(initial=0.0))
    parts = int(np.ceil(longest / options.longest_step))
    q, residual = configurations, largest_residual(mechanism, configurations)
    for _ in range(parts):
        G, _ = velocity_map(mechanism, Constraint(mechanism, q).scaled()[1], chosen, dependent)
        q = integrate(mechanism, q, np.einsum("nij,nj->ni", G, steps / parts))
        q, residual = _polished(_Points(mechanism, q), dependent, options)
    return q, residual


def nearby_configurations(
    mechanism: Mechanism, configuration: FloatArray, *, options: WalkOptions = WALKS
) -> FloatArray:
    """A closed configuration (nq,), then ends of walks from it that stay closed (n, nq)."""
    if mechanism.rows == 0:
        return configuration[None]  # a tree moves alike everywhere
    nv, generator = mechanism.model.nv, random_generator(0, stream=3)
    places = mechanism.draw_places(np.arange(nv))
    q = np.repeat(configuration[None], options.walks, axis=0)
    for _ in range(options.steps):
        _, jacobian = Constraint(mechanism, q).scaled()
        steps = generator.normal(size=(options.walks, nv))[:, places]
        for k in range(options.walks):
            basis = null_space(jacobian[k], mechanism.closure_rank_tolerance)
            direction = basis @ (basis.T @ steps[k])
            steps[k] = options.step * direction / max(np.abs(direction).max(initial=0.0), 1e-300)
        start = integrate(mechanism, q, steps * mechanism.coordinate_scales)
        q, residual = close_loops(mechanism, start)
    near = max(options.closed * mechanism.length, 2.0 * mechanism.closure_residual)
    return np.concatenate([configuration[None], q[residual <= near]])


def _descend(at: _Points, movable: IntArray, goal: FloatArray, options: ClosingOptions) -> None:
    """Levenberg-Marquardt steps towards a residual, inside the limits."""
    mechanism, length = at.mechanism, at.mechanism.length
    damping = np.full(len(at.q), options.first_damping * length)
    error = np.linalg.norm(at.residual - goal, axis=1)
    for _ in range(options.steps if len(movable) else 0):
        k = np.flatnonzero((error > options.done * length) & (damping < options.stuck * length))
        if not len(k):
            break
        there = _Points(mechanism, _tried(at, k, movable, goal[k], damping[k], options))
        error_there = np.linalg.norm(there.residual - goal[k], axis=1)
        damping[k] *= np.where(error_there < options.worthwhile * error[k], 0.3, 4.0)
        damping = np.maximum(damping, options.least_damping * length)
        better = error_there < error[k]
        at.replace(k, there, better)
        error[k[better]] = error_there[better]


def _polished(
    at: _Points, movable: IntArray, options: ClosingOptions
) -> tuple[FloatArray, FloatArray]:
    """Plain Gauss-Newton steps to round-off, kept where they shrink the residual."""
    k = np.arange(len(at.q))
    for _ in range(options.polish_steps if len(movable) else 0):
        factors = Factorisation.of(
            at.jacobian[k][:, :, movable], at.mechanism.closure_rank_tolerance
        )
        step = -factors.solve(at.residual[k][:, :, None])[:, :, 0]
        there = _Points(at.mechanism, _moved(at, k, movable, step, options))
        better = there.largest < at.largest[k]
        at.replace(k, there, better)
        k = k[better & (np.abs(step).max(axis=1, initial=0.0) > options.short)]
        if not len(k):
            break
    return at.q, at.largest


def _tried(
    at: _Points,
    rows: IntArray,
    movable: IntArray,
    goal: FloatArray,
    damping: FloatArray,
    options: ClosingOptions,
) -> FloatArray:
    """Configurations after a damped step, in which joints that their limits stop take no part."""
    mechanism, q = at.mechanism, at.q[rows]
    moves = np.zeros(mechanism.model.nq, dtype=bool)
    moves[mechanism.first_positions[movable]] = True
    lower, upper = mechanism.position_limits
    lower, upper = np.where(moves, lower, -np.inf), np.where(moves, upper, np.inf)
    columns, open_by = at.jacobian[rows][:, :, movable], at.residual[rows] - goal

    def moved(columns: FloatArray) -> FloatArray:
        # Normal equations would lift round-off, and let processors find other poses.
        factors = Factorisation.of(columns, mechanism.closure_rank_tolerance)
        step = -factors.solve(open_by[:, :, None], damping)[:, :, 0]
        return _moved(at, rows, movable, step, options)

    ahead = moved(columns)
    beyond = ((q <= lower) & (ahead < lower)) | ((q >= upper) & (ahead > upper))
    if beyond.any():
        ahead = moved(columns * ~beyond[:, None, mechanism.first_positions[movable]])
    return np.clip(ahead, lower, upper)


def _moved(
    at: _Points, rows: IntArray, movable: IntArray, step: FloatArray, options: ClosingOptions
) -> FloatArray:
    """Configurations of some rows moved by scaled steps (N, u) of limited length."""
    mechanism, longest = at.mechanism, np.abs(step).max(axis=1, initial=0.0)
    step = step * np.minimum(1.0, options.longest_step / np.maximum(longest, 1e-300))[:, None]
    tangent = np.zeros((len(rows), mechanism.model.nv))
    tangent[:, movable] = step * mechanism.coordinate_scales[movable]
    return integrate(mechanism, at.q[rows], tangent)
