"""Closing the loops from any configuration by damped Gauss-Newton steps [Nocedal2006, ch. 10].

All starts advance together, each with its own damping; every linear solve is batched.

Assembly modes are the closed poses that the same values of the motors allow. Loops that share no
dependent coordinate are assembled each on its own. Ten parallelograms need as many starts as one.
Modes meet at singular poses, such as that of a folded parallelogram. There they are separated a
step of the motors away.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice

import numpy as np

from loopid.arguments import BoolArray, FloatArray, IntArray, checked, random_generator, samples
from loopid.kinematics.assembly import follow_paths, largest_opening
from loopid.kinematics.constraint import Constraint, largest_residual
from loopid.kinematics.measured import JointCoordinates
from loopid.kinematics.poses import FramePoses, difference, frame_poses, integrate
from loopid.kinematics.projection import (
    NEAR_SINGULARITY,
    Factorisation,
    least_over_largest,
    null_space,
    partition,
    singularity_measure,
    velocity_map,
)
from loopid.robot.robot import AssemblyMode, Loop, Robot

FOLDED = 0.02  # singularity measure of a drawn pose at which modes count as meeting
DIGITS = 4  # to which distances differ: round-off does not choose


# Steps and damping are in rad or characteristic lengths, as the scaled Jacobian has them; they are
# so short because far starts are to reach the nearest closed configuration.
LONGEST_STEP = 0.3
DAMPED_STEPS, PLAIN_STEPS = 100, 12  # at most
FIRST_DAMPING, STUCK = 0.1, 1e3  # the damping to begin with, and at which nothing helps
LEAST_DAMPING = 1e-3  # below it steps zigzag between far starts and take long to be damped again
WORTHWHILE = 0.999  # a step that leaves more of the error is damped more
LESS, MORE = 0.3, 4.0  # factors of the damping after a step that helps, and after another
DONE = 1e-9  # the error, in characteristic lengths, from which on plain steps do better
SHORT = 1e-8  # a plain step this short leaves an error of round-off
WALKS, WALK_STEPS, STEP = 8, 3, 0.1  # to poses nearby, each step in rad or characteristic lengths
CLOSED = 1e-7  # residual of poses nearby that counts as closed, in characteristic lengths


class _Points:
    """Configurations (N, nq) with their scaled residual and Jacobian, found once each."""

    def __init__(self, robot: Robot, q: FloatArray) -> None:
        self.robot, self.q = robot, q.copy()
        self.residual, self.jacobian = Constraint(robot, q).scaled()

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
    robot: Robot, configurations: FloatArray, movable: IntArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Move coordinates, by velocity indices, until the loops close, as far as they do.

    From starts (N, nq) to configurations (N, nq), inside the limits where that closes them. With
    the largest closure residual (N,) that is left, in m.
    """
    free = np.arange(robot.model.nv) if movable is None else movable
    points = _Points(robot, configurations)
    _descend(points, free)
    return _polished(points, free)


@checked
def displaced(
    robot: Robot, configurations: FloatArray, steps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move closed configurations (N, nq) by steps (N, dof) of the independent coordinates.

    The way for coordinates that have no value of their own, such as the spin of a rod in a ball
    joint. The rates u̇ are integrated along G. Newton steps of the others keep the loops closed.

    Parameters
    ----------
    robot : Robot
    configurations, steps : FloatArray
        Steps are in rad or m.

    Returns
    -------
    configurations : FloatArray
    residual : FloatArray
        (N,), what is left of it in m: large where the way met a singularity.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load("five_bar")
    >>> step = np.array([[0.1, 0.0]])
    >>> q, residual = loopid.kinematics.displaced(robot, robot.reference[None], step)
    >>> q.shape, bool(residual[0] < 1e-9)
    ((1, 4), True)
    """
    chosen, dependent = partition(robot)
    configurations = samples(configurations, robot.model.nq, "configurations")
    steps = samples(steps, len(chosen), "steps", len(configurations))
    longest = float(np.abs(steps / robot.coordinate_scales[chosen]).max(initial=0.0))
    parts = int(np.ceil(longest / LONGEST_STEP))
    q, residual = configurations, largest_residual(robot, configurations)
    for _ in range(parts):
        G, _ = velocity_map(robot, Constraint(robot, q).scaled()[1], chosen, dependent)
        q = integrate(robot, q, np.einsum("nij,nj->ni", G, steps / parts))
        q, residual = _polished(_Points(robot, q), dependent)
    return q, residual


def nearby_configurations(robot: Robot, configuration: FloatArray) -> FloatArray:
    """A closed configuration (nq,), then ends of walks from it that stay closed (n, nq)."""
    if robot.rows == 0:
        return configuration[None]  # a tree moves alike everywhere
    nv, generator = robot.model.nv, random_generator(0, stream=3)
    places = robot.draw_places(np.arange(nv))
    q = np.repeat(configuration[None], WALKS, axis=0)
    for _ in range(WALK_STEPS):
        _, jacobian = Constraint(robot, q).scaled()
        steps = generator.normal(size=(WALKS, nv))[:, places]
        for k in range(WALKS):
            basis = null_space(jacobian[k], robot.closure_rank_tolerance)
            direction = basis @ (basis.T @ steps[k])
            steps[k] = STEP * direction / max(np.abs(direction).max(initial=0.0), 1e-300)
        start = integrate(robot, q, steps * robot.coordinate_scales)
        q, residual = close_loops(robot, start)
    near = max(CLOSED * robot.length, 2.0 * robot.closure_residual)
    return np.concatenate([configuration[None], q[residual <= near]])


def _descend(at: _Points, movable: IntArray) -> None:
    """Levenberg-Marquardt steps inside the limits."""
    robot, length = at.robot, at.robot.length
    damping = np.full(len(at.q), FIRST_DAMPING * length)
    error = np.linalg.norm(at.residual, axis=1)
    for _ in range(DAMPED_STEPS if len(movable) else 0):
        k = np.flatnonzero((error > DONE * length) & (damping < STUCK * length))
        if not len(k):
            break
        there = _Points(robot, _tried(at, k, movable, damping[k]))
        error_there = np.linalg.norm(there.residual, axis=1)
        damping[k] *= np.where(error_there < WORTHWHILE * error[k], LESS, MORE)
        damping = np.maximum(damping, LEAST_DAMPING * length)
        better = error_there < error[k]
        at.replace(k, there, better)
        error[k[better]] = error_there[better]


def _polished(at: _Points, movable: IntArray) -> tuple[FloatArray, FloatArray]:
    """Plain Gauss-Newton steps to round-off, kept where they shrink the residual."""
    k = np.arange(len(at.q))
    for _ in range(PLAIN_STEPS if len(movable) else 0):
        factors = Factorisation.of(at.jacobian[k][:, :, movable], at.robot.closure_rank_tolerance)
        step = -factors.solve(at.residual[k][:, :, None])[:, :, 0]
        there = _Points(at.robot, _moved(at, k, movable, step))
        better = there.largest < at.largest[k]
        at.replace(k, there, better)
        k = k[better & (np.abs(step).max(axis=1, initial=0.0) > SHORT)]
        if not len(k):
            break
    return at.q, at.largest


def _tried(at: _Points, rows: IntArray, movable: IntArray, damping: FloatArray) -> FloatArray:
    """Configurations after a damped step, in which joints that their limits stop take no part."""
    robot, q = at.robot, at.q[rows]
    moves = np.zeros(robot.model.nq, dtype=bool)
    moves[robot.first_positions[movable]] = True
    lower, upper = robot.position_limits
    lower, upper = np.where(moves, lower, -np.inf), np.where(moves, upper, np.inf)
    columns, open_by = at.jacobian[rows][:, :, movable], at.residual[rows]

    def moved(columns: FloatArray) -> FloatArray:
        # Normal equations would lift round-off, and let processors find other poses.
        factors = Factorisation.of(columns, robot.closure_rank_tolerance)
        step = -factors.solve(open_by[:, :, None], damping)[:, :, 0]
        return _moved(at, rows, movable, step)

    ahead = moved(columns)
    beyond = ((q <= lower) & (ahead < lower)) | ((q >= upper) & (ahead > upper))
    if beyond.any():
        ahead = moved(columns * ~beyond[:, None, robot.first_positions[movable]])
    return np.clip(ahead, lower, upper)


def _moved(at: _Points, rows: IntArray, movable: IntArray, step: FloatArray) -> FloatArray:
    """Configurations of some rows moved by scaled steps (N, u) of limited length."""
    robot, longest = at.robot, np.abs(step).max(axis=1, initial=0.0)
    step = step * np.minimum(1.0, LONGEST_STEP / np.maximum(longest, 1e-300))[:, None]
    tangent = np.zeros((len(rows), robot.model.nv))
    tangent[:, movable] = step * robot.coordinate_scales[movable]
    return integrate(robot, at.q[rows], tangent)


# Assembly modes.


# Starts of the passive joints, ever further from the drawn pose. Each is one of every loop: fewer
# do where there are many.
STARTS, STARTS_OF_MANY, MANY_LOOPS = 64, 16, 8
MOST_MODES = 8
# Steps of the motors away from a folded pose, in rad or characteristic lengths, and their number.
LEAST_STEP, LARGEST_STEP, MOTOR_STEPS = 0.15, 0.35, 4
SAME = 1e-4  # characteristic lengths between points in the same pose
PARALLEL = 1e-4  # relative rate at which parallel links may turn against each other
# A mode leads to the drawn pose when a part of the step away from it leaves at most a part of the
# distance: where two branches fold, it falls with the root.
BACK, LEFT = 0.1, 0.5


@dataclass(frozen=True)
class _Solution:
    """One way of assembling one loop: a configuration that has it, and what speaks for it."""

    q: FloatArray
    points: FloatArray
    distance: float
    parallel: int
    continues: bool = False

    @property
    def order(self) -> tuple[object, ...]:
        """The least is chosen; of mirror images any one, but always the same."""
        last = tuple(np.round(-self.points, DIGITS).ravel())
        parallel = -self.parallel if self.continues else 0
        return not self.continues, parallel, round(self.distance, DIGITS), last


def assembly_modes(robot: Robot, drawn: FloatArray) -> tuple[AssemblyMode, ...]:
    """Assembly modes of a robot around a drawn pose (nq,), closed or not; the best first.

    The robot is closed at its reference: the drawn pose, or one near it. Modes that lead to a
    singular drawn pose come first, among them those in which most links stay parallel. Then come
    those of least motion. There are none where no regular pose inside the limits is found.
    """
    motors = JointCoordinates(robot, robot.measured)
    home = robot.reference[None]
    folded = bool(singularity_measure(robot, home)[0] < FOLDED)
    loops = [_LoopPoses(motors, loop, drawn) for loop in robot.loops]
    origin = motors.read(home)
    for step in _motor_steps(motors, origin[0]) if folded else [np.zeros(motors.width)]:
        starts = motors.write(np.concatenate([home, _scattered(motors, drawn)]), origin + step)
        q = _unwound(robot, close_loops(robot, starts, motors.unknown)[0], drawn)
        found = [loop.solutions(q) for loop in loops]
        if all(found):
            break
    else:
        return ()
    base = q[0]
    for loop, solutions in zip(loops, found, strict=True):
        base = loop.put(base, solutions[0].q)
    if folded:
        found = _told_apart(motors, loops, found, base, origin + BACK * step)
    ranked = [sorted(solutions, key=lambda solution: solution.order) for solutions in found]
    modes = []
    for choice in islice(_choices([len(solutions) for solutions in ranked]), MOST_MODES):
        parts = [solutions[k] for solutions, k in zip(ranked, choice, strict=True)]
        for loop, part in zip(loops, parts, strict=True):
            base = loop.put(base, part.q)
        (q,), _ = close_loops(robot, base[None], motors.unknown)
        distance = float(np.linalg.norm([part.distance for part in parts]))
        continues, parallel = all(p.continues for p in parts), sum(p.parallel for p in parts)
        modes.append(AssemblyMode(q, distance, continues, parallel))
    return tuple(modes)


def _choices(counts: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Which solution to take of each loop: the first ones, then one, two, ... others."""
    others = [(loop, k) for loop, count in enumerate(counts) for k in range(1, count)]
    for size in range(len(counts) + 1):
        for changes in combinations(others, size):
            choice = dict(changes)
            if len(choice) == size:
                yield tuple(choice.get(loop, 0) for loop in range(len(counts)))


def _motor_steps(motors: JointCoordinates, origin: FloatArray) -> Iterator[FloatArray]:
    """Steps (m,) of the motors: first towards the farther limits, then in any direction."""
    robot, generator = motors.robot, random_generator(0, stream=4)
    limits = np.array([robot.limits(name) for name in robot.measured]).reshape(-1, 2)
    down, up = origin - limits[:, 0], limits[:, 1] - origin
    places = robot.draw_places(motors.known)
    for attempt in range(MOTOR_STEPS):
        size = generator.uniform(LEAST_STEP, LARGEST_STEP, motors.width)[places]
        upwards = generator.uniform(size=motors.width)[places] < 0.5 if attempt else up >= down
        room = 0.5 * np.where(upwards, up, down)
        size = np.minimum(size * robot.coordinate_scales[motors.known], room)
        yield np.where(upwards, 1.0, -1.0) * np.maximum(size, 0.0)


def _scattered(motors: JointCoordinates, drawn: FloatArray) -> FloatArray:
    """The drawn pose (N, nq) with passive joints ever further away, up to half a turn."""
    many = len(motors.robot.loops) > MANY_LOOPS
    count = STARTS_OF_MANY if many else STARTS
    radius = np.pi * np.linspace(0.0, 1.0, count)[:, None]
    steps = random_generator(0, stream=5).uniform(-1.0, 1.0, (count, len(motors.unknown)))
    steps = steps[:, motors.robot.draw_places(motors.unknown)]
    starts = np.repeat(drawn[None], count, axis=0)
    return integrate(motors.robot, starts, motors.tangent(radius * steps))


def _unwound(robot: Robot, q: FloatArray, drawn: FloatArray) -> FloatArray:
    """Configurations (N, nq) without whole turns of joints away from a drawn one (nq,)."""
    coupled = {name for coupling in robot.couplings for name in coupling.joints}
    joints = [robot.joint(name) for name in robot.joints if name not in coupled]
    turning = [
        joint.idx_q
        for joint in joints
        if joint.nq == joint.nv == 1 and joint.idx_v not in robot.prismatic
    ]
    nearest = q.copy()
    turns = np.round((q[:, turning] - drawn[turning]) / (2 * np.pi))
    nearest[:, turning] -= 2 * np.pi * turns
    return np.where(robot.outside(nearest), q, nearest)


def _told_apart(
    motors: JointCoordinates,
    loops: Sequence[_LoopPoses],
    found: Sequence[Sequence[_Solution]],
    base: FloatArray,
    back: FloatArray,
) -> list[list[_Solution]]:
    """The solutions, with whether they lead back to the singular pose that is the reference."""
    own = [(loop, one) for loop, solutions in zip(loops, found, strict=True) for one in solutions]
    away = np.stack([loop.put(base, one.q) for loop, one in own])
    path = follow_paths(motors, away, np.repeat(back, len(away), axis=0))
    near = np.where(path.assembled[:, None], path.configurations, away)
    marked: list[list[_Solution]] = [[] for _ in loops]
    for k, (loop, one) in enumerate(own):
        points = loop.points(np.stack([motors.robot.reference, away[k], near[k]]))
        first, left = (float(np.abs(points[i] - points[0]).max(initial=0.0)) for i in (1, 2))
        # Where the first ones do not lead back, the others were not tried on their own.
        continues = left <= LEFT * first or not path.assembled[0]
        marked[loops.index(loop)].append(replace(one, continues=continues))
    return marked


class _LoopPoses:
    """One loop at configurations: whether it is closed, where its links are, how they turn."""

    def __init__(self, motors: JointCoordinates, loop: Loop, drawn: FloatArray) -> None:
        robot = self.robot = motors.robot
        self.rows, self.drawn = loop.rows, drawn
        self.passive = np.intersect1d(loop.columns, motors.unknown)
        self.driving = np.setdiff1d(loop.columns, motors.unknown)
        joints = {robot.joint_ids[k] for k in loop.columns}
        # Links are seen from the one that carries the loop: the last that is not part of it.
        paths = [set(robot.model.supports[joint]) - joints for joint in joints]
        root = max(set.intersection(*paths), default=0) if paths else 0
        # Of each link the frame at its joint, which does not show how a rod spins.
        frames = sorted(
            enumerate(robot.model.frames),
            key=lambda pair: -float(np.linalg.norm(pair[1].placement.translation)),
        )
        on = {frame.parentJoint: k for k, frame in frames}
        ranked = sorted(joints, key=lambda k: robot.joint_ranks[robot.joints[k - 1]])
        links = [on[joint] for joint in (root, *ranked) if joint in on]
        ends = [frame for closure in loop.closures for frame in closure.frame_ids]
        self.frames = links + ends
        self.own = np.zeros(robot.model.nq, dtype=bool)  # positions of its passive joints
        for joint in (robot.model.joints[robot.joint_ids[k]] for k in self.passive):
            self.own[joint.idx_q : joint.idx_q + joint.nq] = True

    def put(self, q: FloatArray, other: FloatArray) -> FloatArray:
        """A configuration (nq,) with the passive joints of this loop from another one."""
        return np.where(self.own, other, q)

    def points(self, q: FloatArray) -> FloatArray:
        """Origins of the links and ends (N, F, 3) in characteristic lengths, from the first."""
        return self._points(frame_poses(self.robot, q, self.frames, jacobians=False))

    def _points(self, frames: FramePoses) -> FloatArray:
        away = frames.origin - frames.origin[:, :1]
        return np.asarray(away @ frames.rotation[:, 0] / self.robot.length)

    def solutions(self, q: FloatArray) -> list[_Solution]:
        """Different poses among those (N, nq) that close the loop, regular and inside limits."""
        robot = self.robot
        residual, jacobian = Constraint(robot, q).scaled()
        jacobian = jacobian[:, self.rows]
        open_by = np.abs(residual[:, self.rows]).max(axis=1, initial=0.0)
        good = open_by <= largest_opening(robot)
        good &= least_over_largest(jacobian[:, :, self.passive]) >= NEAR_SINGULARITY
        good &= ~robot.outside(q)[:, self.own].any(axis=1)
        frames = frame_poses(robot, q, self.frames)
        points, found = self._points(frames), list[_Solution]()
        for k in np.flatnonzero(good):
            if all(np.abs(points[k] - other.points).max() > SAME for other in found):
                turning = self._turning(jacobian[k], frames.angular[k])
                away = difference(robot, self.drawn[None], q[k, None])[0] / robot.coordinate_scales
                distance = float(np.linalg.norm(away[self.passive]))
                apart = np.abs(turning[:, None] - turning[None]).max(axis=2, initial=0.0)
                alike = apart <= PARALLEL * np.abs(turning).max(initial=1e-300)
                parallel = int(np.triu(alike, 1).sum())  # pairs of links that turn alike
                found.append(_Solution(q[k], points[k], distance, parallel))
        return found

    def _turning(self, jacobian: FloatArray, angular: FloatArray) -> FloatArray:
        """Rates (F, 3 k) of turning against the first link, per unit of what drives the loop."""
        driven = Factorisation.of(jacobian[None][:, :, self.passive])
        rates = -driven.solve(jacobian[None][:, :, self.driving])[0]
        scales, relative = self.robot.coordinate_scales, angular - angular[:1]
        turning = relative[:, :, self.driving] * scales[self.driving]
        turning = turning + (relative[:, :, self.passive] * scales[self.passive]) @ rates
        return np.asarray(turning.reshape(len(turning), -1))
