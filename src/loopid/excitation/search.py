"""The search for a motion: starts share evaluations, and only motions that pass the check count.

A start is a random motion, shrunk around a pose until it keeps all bounds. A solver goes on from
there. All that it does follows from the start and the number of evaluations. So more of them never
give a worse motion. The clock, and Ctrl-C, only stop it.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import monotonic
from types import FrameType
from typing import NamedTuple

import numpy as np

from loopid.arguments import BoolArray, FloatArray
from loopid.errors import AssemblyError
from loopid.excitation.problem import INSET, SOLVERS, Problem, Value, evaluate, follow
from loopid.kinematics.assembly import AssemblyOptions, largest_opening, try_assemble
from loopid.kinematics.constraint import largest_residual
from loopid.kinematics.measured import measured_coordinates
from loopid.kinematics.projection import closed_motion, singularity_measure
from loopid.numbers import SOLVED_ROUND_OFF
from loopid.records import record

# The grid of the check is so much finer; speeds and accelerations up to this are rest.
FINER, REST = 10, 1e-6
# How many of the best random poses are improved, how often, and how: by some steps from each, of a
# part of the workspace that gets smaller.
BEST, ROUNDS, TRIED, FIRST_PART, SMALLER = 8, 14, 4, 0.3, 0.75
# Of the unit step of a coordinate, that it is taken to reach at least; the singularity measure from
# which on a pose has velocities; and part of the way to a pose, below which it is out of reach.
LEAST_REACH, REGULAR, SHORTEST_STEP = 1e-3, 1e-6, 2.0**-6
# Random motions for a start, and by how much they are shrunk until they keep all bounds.
DRAWS, SHRINK, MOST_SHRINKS = 3, 0.8, 40
# Bounds that keep this distance at the start, in scales, are left out of the problem until they
# have been broken at this many points: most never matter, and each costs a row a sample.
DISTANT, PATIENCE = 0.35, 4
# A criterion that is better by so much is worth a check on the finer grid, which takes as long as
# an evaluation: one percent in a volume, or in a condition number.
WORTH_A_CHECK = 0.01
# Parts of a motion's size that are tried where the finer grid shows a broken bound.
SHRINKS = (1.0, 0.997, 0.99, 0.97, 0.9)
TO_REST = (0.7, 0.5, 0.25, 0.1, 0.03, 0.01, 0.0)

# Called with the evaluations done, those in all, and the best criterion so far.
DesignProgress = Callable[[int, int, float], None]


class Broken(Exception):  # noqa: N818 (no error)
    """A bound that was left out matters."""


class Stuck(Exception):  # noqa: N818 (no error)
    """The solver cannot go on."""


class Stopped(Exception):  # noqa: N818 (no error)
    """There are no evaluations left, or no time."""


@record
class Check:
    """A bounded quantity over a whole motion."""

    name: str
    unit: str
    lowest: float  # of the motion
    highest: float
    lower: float  # what it must keep; infinite where there is no end
    upper: float
    time: float  # when it is nearest to an end, in s
    violations: int  # samples at which the bound is broken


def check_motion(problem: Problem, X: FloatArray) -> tuple[Check, ...]:
    """Check variables X (m, c) of a motion; empty where it leaves the assembly mode."""
    time = np.linspace(0.0, problem.shape.seconds, FINER * len(problem.time) + 1)
    motion = follow(problem.robot, *(problem.shape.functions(time) @ X))
    if motion is None:
        return ()
    robot, checks, ends = problem.robot, list[Check](), [0, -1]

    def check(name: str, unit: str, times: FloatArray, values: FloatArray, *keep: float) -> None:
        lower, upper, scale = keep
        slack = np.minimum(values - lower, upper - values)
        broken, nearest = int((slack < -SOLVED_ROUND_OFF * scale).sum()), times[int(slack.argmin())]
        span = float(values.min()), float(values.max())
        checks.append(Check(name, unit, *span, lower, upper, float(nearest), broken))

    for bound, column in zip(problem.bounds.all, problem.bounded(motion).T, strict=True):
        check(bound.text, bound.unit, time, column, bound.lower, bound.upper, bound.scale)
    if robot.rows:
        residual = largest_residual(robot, motion.configurations)
        largest = largest_opening(robot)
        check("closure residual", "m", time, residual, -np.inf, largest, robot.length)
    speeds = np.abs(np.concatenate([motion.velocities[ends], motion.accelerations[ends]], axis=1))
    resting = speeds.max(axis=1, initial=0.0)
    check("speed at both ends", "", time[ends], resting, -np.inf, REST, 1.0)
    return tuple(checks)


class Poses(NamedTuple):
    """Poses in which all bounds hold, the one with most slack first."""

    positions: FloatArray  # (P, c), of the coordinates of the design
    configurations: FloatArray  # (P, nq)
    reach: FloatArray  # (c,), half the range of each coordinate


def find_poses(problem: Problem, configurations: FloatArray) -> Poses:
    """Poses that keep all bounds, from random configurations (N, nq) on.

    An AssemblyError names the bounds that none of them keeps.
    """
    robot = problem.robot
    generator = np.random.default_rng([problem.options.seed, 11])
    measured = measured_coordinates(robot)
    x = measured.read(np.concatenate([robot.reference[None], configurations]))
    reach = np.maximum(np.ptp(x, axis=0) / 2, LEAST_REACH * problem.units)
    # Random poses miss narrow ranges, which their nearest ends may keep.
    low, high = problem.bounds.ranges(robot.independent, 2 * INSET)
    x = np.concatenate([x, np.clip(x, low, high)])
    slack, q = _slacks(problem, x)
    tried, nearest, step = len(x), slack.max(axis=0), FIRST_PART
    for _ in range(ROUNDS):
        best = np.argsort(-slack.min(axis=1), kind="stable")[:BEST]
        if slack[best[0]].min() > INSET:
            break
        moves = step * reach * generator.normal(size=(TRIED * len(best), len(reach)))
        x = np.concatenate([x[best], np.repeat(x[best], TRIED, axis=0) + moves])
        there, at = _slacks(problem, x[len(best) :])
        slack, q = np.concatenate([slack[best], there]), np.concatenate([q[best], at])
        tried, step = tried + len(moves), SMALLER * step
        nearest = np.maximum(nearest, slack.max(axis=0))
    worst = slack.min(axis=1)
    order = [int(k) for k in np.argsort(-worst, kind="stable") if worst[k] > INSET]
    if not order:
        raise _impossible(problem, slack[int(worst.argmax())], nearest, tried)
    return Poses(x[order], q[order], reach)


def _slacks(problem: Problem, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slacks (N, k) of all bounds at rest in poses (N, c), -inf if out of reach; configurations."""
    robot, found = problem.robot, np.full((len(positions), len(problem.bounds.all)), -np.inf)
    options = AssemblyOptions(shortest_step=SHORTEST_STEP)
    outcome = try_assemble(robot, positions, options=options)
    q = outcome.configurations[outcome.assembled]
    regular = singularity_measure(robot, q) > REGULAR
    rows = np.flatnonzero(outcome.assembled)[regular]
    if len(rows):
        still = np.zeros((len(rows), len(robot.independent)))
        values = problem.bounded(closed_motion(robot, q[regular], still, still))
        found[rows] = problem.bounds.slack(values)
    return found, outcome.configurations


def _impossible(
    problem: Problem, best: FloatArray, nearest: FloatArray, tried: int
) -> AssemblyError:
    """Which bounds cannot be met: by no pose alone, else by the best one (k,) together."""
    name, bounds = problem.robot.name, problem.bounds.all
    alone = bool((nearest <= INSET).any())
    left = nearest if alone else best
    k = int(left.argmin())
    if not np.isfinite(nearest[k]):
        message = f"none of {tried} poses of {name} can be assembled: check reference and limits"
        return AssemblyError(message, poses=tried)
    missing = -float(left[k]) * bounds[k].scale
    broken = [k] if alone else np.flatnonzero(best <= INSET)
    listed = ", ".join(f"{bounds[j].text} in {bounds[j].ends}" for j in broken)
    by = f"{bounds[k].text} by {missing:.4g} {bounds[k].unit}".rstrip()
    return AssemblyError(
        f"{name} cannot keep {'' if alone else 'at once '}the {listed}: the nearest of {tried} "
        f"poses misses the {by}, with a margin of {INSET:.0%}: widen it by more",
        bound=bounds[k].text,
        lower=bounds[k].lower,
        upper=bounds[k].upper,
        missing=missing,
        poses=tried,
    )


def feasible_start(problem: Problem, poses: Poses, number: int) -> tuple[FloatArray, FloatArray]:
    """Variables of a random motion, shrunk until it keeps all bounds; its configurations."""
    generator = np.random.default_rng([problem.options.seed, 12, number])
    among, still = max(1, len(poses.positions) // 2), problem.shape.still()
    best = problem.of_variables(np.outer(still, poses.positions[0])), poses.configurations[:1]
    value = np.inf
    for draw in range(DRAWS):
        k = 0 if draw == number == 0 else int(generator.integers(among))
        centre = np.outer(still, poses.positions[k])
        around = problem.shape.draw(generator, len(poses.reach)) * poses.reach
        for _ in range(MOST_SHRINKS):
            around = SHRINK * around
            y = problem.of_variables(centre + around)
            found = evaluate(problem, y, poses.configurations[k, None], slopes=False)
            if found is not None and problem.keeps_bounds(found):
                if found.f < value:
                    best, value = (y, found.q), found.f
                break
    return best


@dataclass
class Search:
    """The points that a solver evaluates, each evaluated once, and the best ones."""

    problem: Problem
    best: FloatArray  # variables (n,) of the best point that keeps all bounds on the grid
    reached: FloatArray  # configurations (N, nq) there
    home: FloatArray  # variables (m, c) of standing in a pose
    most: int  # evaluations
    # Told the evaluations done and the best criterion; answers whether to stop.
    watch: Callable[[int, float], bool]
    criterion: float = np.inf  # of the best point
    evaluations: int = 0
    # (k,), the bounds that the solver gets
    watched: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    # Variables (m, c) of the best motion that passes the check, its criterion, and the check
    X: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    checked: float = np.inf
    checks: tuple[Check, ...] = ()
    converged: bool = False  # whether the solver ended by itself
    # Configurations (N, nq) from which the next point is reached
    near: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    _looked_at: float = np.inf
    _missed: int = 0
    _at: dict[bytes, Value | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.start = self.problem.variables(self.best)  # (m, c)

    def run(self) -> None:
        """Let a solver work, again from its best point while that helps."""
        self._begin()
        before, solve = np.inf, SOLVERS[self.problem.solver]
        try:
            while self.criterion < before - WORTH_A_CHECK:
                before, self.near, self._at = self.criterion, self.reached, {}
                try:
                    solve(self, self.best.copy())  # solvers write into their start
                except Broken:
                    before = np.inf
                except Stuck:
                    continue
        except Stopped:
            return
        self._check(self.best, self.criterion, SHRINKS)
        self.converged = True

    def value(self, y: FloatArray, slopes: bool = False) -> Value | None:
        """Criterion and bounds at a point, with slopes if required; None out of reach."""
        key = y.tobytes()
        known = self._at.get(key)
        if key in self._at and (known is None or known.df.size or not slopes):
            return known
        if self.evaluations >= self.most or self.watch(self.evaluations, self.checked):
            raise Stopped
        self.evaluations += 1
        found = evaluate(self.problem, y, self.near if known is None else known.q, slopes)
        # The last two points: solvers ask again for the value and the slopes of one.
        self._at = {key: found} if known is None and len(self._at) > 2 else self._at | {key: found}
        if found is not None:
            self.near = found.q
            if found.f < self.criterion and self.problem.keeps_bounds(found):
                self.best, self.reached, self.criterion = y.copy(), found.q, found.f
                if found.f < self._looked_at - WORTH_A_CHECK:
                    self._check(y, found.f, SHRINKS)
            self._look_at_bounds(found)
        return found

    def _begin(self) -> None:
        """Check the start, or what is left of it on the way to a pose; the pose at the worst."""
        found = evaluate(self.problem, self.best, self.reached, slopes=False)
        if found is not None:
            self.reached, self.criterion = found.q, found.f
            self._look_at_bounds(found)
            self._check(self.best, found.f, SHRINKS)
        for part in TO_REST:
            if self.checks:
                return
            X = self.home + part * (self.problem.variables(self.best) - self.home)
            self._check(self.problem.of_variables(X), np.inf, (1.0,), last=part == 0.0)

    def _check(
        self, y: FloatArray, criterion: float, shrinks: tuple[float, ...], last: bool = False
    ) -> None:
        """Keep a motion that passes the check, shrunk if need be, and is better."""
        problem, X = self.problem, self.problem.variables(y)
        self._looked_at = min(self._looked_at, criterion)
        middle = np.outer(problem.shape.still(), (problem.functions[0] @ X).mean(axis=0))
        for part in shrinks:
            shrunk = X if part == 1.0 else middle + part * (X - middle)
            checks = check_motion(problem, shrunk)
            if last or (checks and not any(check.violations for check in checks)):
                if part < 1.0 or not np.isfinite(criterion):
                    value = evaluate(problem, problem.of_variables(shrunk), self.reached, False)
                    criterion = np.inf if value is None else value.f
                if criterion < self.checked or not self.checks:
                    self.X, self.checked, self.checks = shrunk, criterion, checks
                return

    def _look_at_bounds(self, found: Value) -> None:
        """Take in bounds that are near, first of all, or broken again and again, with a restart."""
        lower, upper = self.problem.limits
        left = np.minimum(found.g - lower, upper - found.g).min(axis=0)
        if not len(self.watched):
            self.watched = left < DISTANT
        elif (left[~self.watched] < 0).any():
            self._missed += 1
            if self._missed >= PATIENCE:
                self._missed = 0
                self.watched = self.watched | (left < DISTANT / 2)
                raise Broken


def search(problem: Problem, poses: Poses, progress: DesignProgress | None = None) -> Search:
    """The best search of all starts, one after the other; converged ones leave evaluations over.

    Its evaluations, and whether it converged, are of all.
    """
    options, found, spent = problem.options, list[Search](), 0
    end = np.inf if options.time_limit is None else monotonic() + options.time_limit
    with _interrupted() as interrupted:

        def watch(evaluations: int, criterion: float) -> bool:
            if progress is not None:
                best = min([criterion, *(each.checked for each in found)])
                progress(spent + evaluations, options.evaluations, best)
            return interrupted.is_set() or monotonic() > end

        home = np.outer(problem.shape.still(), poses.positions[0])
        for number in range(options.starts):
            if found and watch(0, np.inf):
                break
            y, near = feasible_start(problem, poses, number)
            share = (options.evaluations - spent) // (options.starts - number)
            one = Search(problem, y, near, home, share, watch)
            one.run()
            spent += one.evaluations
            found.append(one)
    best = min(found, key=lambda each: each.checked)
    best.converged = len(found) == options.starts and all(each.converged for each in found)
    best.evaluations = spent
    return best


@contextmanager
def _interrupted() -> Iterator[threading.Event]:
    """An event that Ctrl-C sets; a second Ctrl-C ends the program."""
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return

    def stop(number: int, frame: FrameType | None) -> None:
        if event.is_set():
            raise KeyboardInterrupt
        event.set()

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)
