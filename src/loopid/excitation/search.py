"""Starts that keep all bounds, and the searches from them until the time is up.

A start is a random motion, shrunk around a pose that keeps all bounds. From there libraries go on:
IPOPT where it is installed, SciPy's SLSQP elsewhere. Both may leave the feasible set on their way,
and both may be stopped at any time: what counts is the best feasible point that was seen, and every
start is one.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import active_children
from os import kill
from time import monotonic
from types import FrameType
from typing import Any

import numpy as np

from loopid.arguments import (
    BoolArray,
    FloatArray,
)
from loopid.errors import (
    AssemblyError,
    MissingExtraError,
)
from loopid.excitation.problem import (
    Problem,
    Value,
    evaluate,
)
from loopid.kinematics.assembly import (
    AssemblyOptions,
    try_assemble,
)
from loopid.kinematics.measured import measured_coordinates
from loopid.kinematics.projection import singularity_measure
from loopid.robot.mechanism import Mechanism
from loopid.workers import ordered_map

# How many of the best random poses are improved, how often, and how: by steps of a part of
# the workspace that gets smaller.
BEST, ROUNDS, SMALLER = 8, 14, 0.75
# Random motions for a start, and by how much they are shrunk until they keep all bounds.
DRAWS, SHRINK, SHRINKS = 3, 0.8, 40
# What stands for a criterion and bounds where the loops do not close.
OUT_OF_REACH = 1e3
# Relative change of the criterion that ends an optimisation.
CONVERGED = 1e-6

# Called with the best criterion so far; answers whether to stop.
Watch = Callable[[float], bool]


# Bounds that keep this distance at the start, in scales, are left out of the problem until they
# have been broken at so many points: most never matter, and each costs a row a sample.
DISTANT, PATIENCE = 0.35, 4


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses in which all bounds hold, the one with most slack first."""

    positions: FloatArray  # (P, c), of the coordinates of the design
    configurations: FloatArray  # (P, nq)
    reach: FloatArray  # (c,), half the range of each coordinate


def slacks(problem: Problem, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slacks (N, k) of all bounds at rest in poses (N, c), and configurations (N, nq).

    Minus infinity where the loops do not close, or at a singularity.
    """
    space, found = problem.coordinates, np.full((len(positions), len(problem.bounds.all)), -np.inf)
    names = "platform" if space.on_platform else space.names
    outcome = try_assemble(
        space.mechanism, positions, names, options=AssemblyOptions(shortest_step=2.0**-6)
    )
    q = outcome.configurations[outcome.assembled]
    # Singular poses have no velocities to tell.
    regular = singularity_measure(space.mechanism, q) > 1e-6
    rows = np.flatnonzero(outcome.assembled)[regular]
    if len(rows):
        still = np.zeros((len(rows), len(space.names)))
        values = problem.outcome(space.whole(q[regular], still, still)).values
        found[rows] = problem.bounds.slack(values)
    return found, outcome.configurations


def find_poses(problem: Problem, configurations: FloatArray, seed: int) -> Poses:
    """Poses that keep all bounds, from random configurations (N, nq) on."""
    space, generator = problem.coordinates, np.random.default_rng([seed, 11])
    names = "platform" if space.on_platform else space.names
    measured = measured_coordinates(space.mechanism, names)
    q = np.concatenate([space.mechanism.reference[None], configurations])
    x = measured.read(q)
    reach = np.maximum(np.ptp(x, axis=0) / 2, 1e-3 * space.units)
    # Random poses miss narrow ranges, which their nearest ends may keep.
    low, high = problem.bounds.ranges(space.names, 2 * problem.inset)
    x = np.concatenate([x, np.clip(x, low, high)])
    slack, q = slacks(problem, x)
    tried, nearest = len(x), slack.max(axis=0)
    step = 0.3
    for _ in range(ROUNDS):
        best = np.argsort(-slack.min(axis=1), kind="stable")[:BEST]
        if slack[best[0]].min() > problem.inset:
            break
        moves = step * reach * generator.normal(size=(4 * len(best), len(reach)))
        x = np.concatenate([x[best], np.repeat(x[best], 4, axis=0) + moves])
        there, at = slacks(problem, x[len(best) :])
        slack, q = np.concatenate([slack[best], there]), np.concatenate([q[best], at])
        tried, step = tried + len(moves), SMALLER * step
        nearest = np.maximum(nearest, slack.max(axis=0))
    worst = slack.min(axis=1)
    order = [int(k) for k in np.argsort(-worst, kind="stable") if worst[k] > problem.inset]
    if not order:
        raise AssemblyError(_impossible(problem, slack, nearest, tried))
    return Poses(x[order], q[order], reach)


def _impossible(problem: Problem, slack: FloatArray, nearest: FloatArray, tried: int) -> str:
    """Which bound cannot be met."""
    best = slack[int(slack.min(axis=1).argmax())]
    impossible = np.flatnonzero(nearest <= problem.inset)
    k = int(impossible[nearest[impossible].argmin()]) if len(impossible) else int(best.argmin())
    bound = problem.bounds.all[k]
    ends = f"{bound.lower:.4g} ... {bound.upper:.4g} {bound.unit}".rstrip()
    name = problem.force_model.mechanism.name
    if not np.isfinite(nearest[k]):
        return f"none of {tried} poses of {name} can be assembled: check the reference and limits"
    by = f"{-float(nearest[k]) * bound.scale:.4g} {bound.unit}".rstrip()
    if len(impossible):
        return (
            f"{name} cannot keep the {bound.text} in {ends}: the nearest of {tried} poses misses "
            f"it by {by}, with a margin of {problem.inset:.0%}: widen it by more than that"
        )
    broken = ", ".join(problem.bounds.all[j].text for j in np.flatnonzero(best <= problem.inset))
    return (
        f"{name} cannot keep all limits at once: the best of {tried} poses breaks those of the "
        f"{broken} ({bound.text} in {ends} by {-float(best[k]) * bound.scale:.4g}): widen one"
    )


def feasible_start(
    problem: Problem, poses: Poses, seed: int, number: int
) -> tuple[FloatArray, FloatArray]:
    """Variables of a motion that keeps all bounds, and its configurations (N, nq) or (1, nq).

    A random motion is shrunk around a regular pose.
    """
    generator = np.random.default_rng([seed, 12, number])
    among, best, value = max(1, len(poses.positions) // 2), None, np.inf
    still = problem.shape.still()
    for draw in range(DRAWS):
        k = 0 if draw == number == 0 else int(generator.integers(among))
        centre = np.outer(still, poses.positions[k])
        around = problem.shape.draw(generator, len(poses.reach)) * poses.reach
        for _ in range(SHRINKS):
            around = SHRINK * around
            y = problem.of_variables(centre + around)
            found = evaluate(problem, y, poses.configurations[k, None], slopes=False)
            if found is not None and problem.violation(found) <= 0:
                if best is None or found.f < value:
                    best, value = (y, found.q), found.f
                break
    if best is None:
        centre = np.outer(still, poses.positions[0])
        return problem.of_variables(centre), poses.configurations[:1]
    return best


def random_margin(mechanism: Mechanism, configurations: FloatArray, most: float) -> float:
    """A singularity measure that most poses keep: so much, or half of their median."""
    if mechanism.rows == 0:
        return most
    return float(min(most, np.median(singularity_measure(mechanism, configurations)) / 2))


# Solvers.


class Broken(Exception):  # noqa: N818 (no error)
    """A bound that was left out matters."""


class Stuck(Exception):  # noqa: N818 (no error)
    """The solver cannot go on."""


class Stopped(Exception):  # noqa: N818 (no error)
    """The watch says that it is enough."""


@dataclass
class Search:
    """The points that a solver asks for, each evaluated once, and the best feasible one."""

    problem: Problem
    watch: Watch
    best: FloatArray
    near: FloatArray
    criterion: float = np.inf
    evaluations: int = 0
    most: int | None = None
    watched: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    trail: list[FloatArray] = field(default_factory=list)
    _missed: int = 0
    _at: dict[bytes, Value | None] = field(default_factory=dict)

    def value(self, y: FloatArray, slopes: bool = False) -> Value | None:
        """Criterion and bounds at a point, with slopes if asked for; None out of reach."""
        key = y.tobytes()
        known = self._at.get(key)
        if key in self._at and (known is None or known.df.size or not slopes):
            return known
        if self.watch(self.criterion) or (self.most is not None and self.evaluations >= self.most):
            raise Stopped
        found = evaluate(self.problem, y, self.near if known is None else known.q, slopes)
        self.evaluations += 1
        self._at = {key: found} if known is None and len(self._at) > 2 else self._at | {key: found}
        if found is None:
            return None
        self.near = found.q
        if found.f < self.criterion and self.problem.violation(found) <= 0:
            self.best, self.criterion = y.copy(), found.f
            self.trail.append(self.best)
        self._look_at(found)
        return found

    def _look_at(self, found: Value) -> None:
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

    def run(self, solve: Callable[[Search, FloatArray], None]) -> bool:
        """Let a solver work until it converges, or the watch says stop; whether it was stopped."""
        try:
            self.value(self.best)
            while True:
                try:
                    solve(self, self.best)
                    return False
                except Broken:
                    continue
        except Stuck:
            return False
        except Stopped:
            return True


def by_slsqp(search: Search, start: FloatArray) -> None:
    """Sequential quadratic programming [Kraft1988], as SciPy has it."""
    lower, upper = search.problem.limits
    below, above = np.isfinite(lower) & search.watched, np.isfinite(upper) & search.watched
    N = len(search.problem.time)

    def bounded(y: FloatArray) -> FloatArray:
        value = search.value(y)
        if value is None:
            return np.full(N * int(below.sum() + above.sum()), -OUT_OF_REACH)
        g = value.g
        return np.concatenate([(g - lower)[:, below], (upper - g)[:, above]], axis=1).ravel()

    def with_slopes(y: FloatArray) -> Value:
        value = search.value(y, True)
        if value is None:  # SLSQP has accepted a point out of reach for want of a better one
            raise Stuck
        return value

    def slopes(y: FloatArray) -> FloatArray:
        dg = with_slopes(y).dg.reshape(N, len(lower), -1)
        return np.concatenate([dg[:, below], -dg[:, above]], axis=1).reshape(-1, dg.shape[2])

    def criterion(y: FloatArray) -> float:
        value = search.value(y)
        return OUT_OF_REACH if value is None else value.f

    from scipy.optimize import minimize  # slow to import

    minimize(
        criterion,
        start,
        jac=lambda y: with_slopes(y).df,
        constraints={"type": "ineq", "fun": bounded, "jac": slopes},
        method="SLSQP",
        options={"maxiter": 10_000, "ftol": CONVERGED},
    )


def by_ipopt(search: Search, start: FloatArray) -> None:
    """The interior-point method of IPOPT [Waechter2006]."""
    try:
        import ipyopt
    except ImportError as error:
        raise MissingExtraError.of("ipyopt", "excite") from error
    N, watched = len(search.problem.time), search.watched
    lower, upper = (np.tile(end[watched], N) for end in search.problem.limits)
    n, m = len(start), len(lower)
    rows, columns = np.divmod(np.arange(m * n), n)

    def guarded(work: Callable[[Value], Any], slopes: bool, out: FloatArray | None) -> Any:
        try:
            value = None if stopped else search.value(current[0], slopes)
        except (Stopped, Broken) as reason:
            stopped.append(reason)
            value = None
        if value is None:
            if out is not None:
                out[...] = np.nan
            return np.nan
        return work(value)

    stopped: list[Exception] = []
    current = [start]

    def slopes_of(value: Value) -> FloatArray:
        return value.dg.reshape(N, len(watched), n)[:, watched].ravel()

    def at(y: FloatArray) -> None:
        current[0] = np.array(y)

    def f(y: FloatArray) -> float:
        at(y)
        return float(guarded(lambda value: value.f, False, None))

    def df(y: FloatArray, out: FloatArray) -> None:
        at(y)
        guarded(lambda value: out.__setitem__(..., value.df), True, out)

    def g(y: FloatArray, out: FloatArray) -> None:
        at(y)
        guarded(lambda value: out.__setitem__(..., value.g[:, watched].ravel()), False, out)

    def dg(y: FloatArray, out: FloatArray) -> None:
        at(y)
        guarded(lambda value: out.__setitem__(..., slopes_of(value)), True, out)

    problem = ipyopt.Problem(
        n,
        np.full(n, -1e19),
        np.full(n, 1e19),
        m,
        np.where(np.isfinite(lower), lower, -1e19),
        np.where(np.isfinite(upper), upper, 1e19),
        (rows, columns),
        (np.array([], int), np.array([], int)),
        f,
        df,
        g,
        dg,
        intermediate_callback=lambda *_: not stopped,
        ipopt_options={
            "print_level": 0,
            "sb": "yes",
            "hessian_approximation": "limited-memory",
            "mu_strategy": "adaptive",
            "mumps_pivot_order": 0,  # AMD: others choke on the dense rows of the Jacobian
            "tol": CONVERGED,
            "max_iter": 10_000,
        },
    )
    problem.solve(start)
    if stopped:
        raise stopped[0]


SOLVERS: dict[str, Callable[[Search, FloatArray], None]] = {"ipopt": by_ipopt, "slsqp": by_slsqp}


# All starts.

# Called with the seconds spent, those in all, and the best criterion so far.
DesignProgress = Callable[[float, float, float], None]


@dataclass(frozen=True, eq=False)
class Found:
    """What one start led to, through which points that keep all bounds on the grid."""

    start: FloatArray
    trail: tuple[FloatArray, ...]
    criterion: float
    evaluations: int
    stopped: bool


def searched(
    problem: Problem,
    poses: Poses,
    solver: str,
    clock: tuple[float, float],
    starts: int,
    iterations: int | None,
    seed: int,
    n_jobs: int,
    progress: DesignProgress | None,
) -> Iterator[Found]:
    """The results of all starts there is time for, one at least, by a clock's start and end."""
    (begun, deadline), best = clock, np.inf
    run = partial(_one_start, problem, poses, solver, iterations, seed)
    with _interruptible() as interrupted:
        if n_jobs > 1:
            rounds = -(-starts // n_jobs)
            each = max(deadline - monotonic(), 0.0) / rounds
            for found in ordered_map(run, [(k, each) for k in range(starts)], n_jobs):
                best = min(best, found.criterion)
                if progress is not None:
                    progress(monotonic() - begun, deadline - begun, best)
                yield found
                if interrupted.is_set():
                    break
            return
        for k in range(starts):
            now = monotonic()
            if k and (interrupted.is_set() or now > deadline):
                break
            share = max(deadline - now, 0.0) / (starts - k)

            def watch(criterion: float, best: float = best) -> bool:
                if progress is not None:
                    progress(monotonic() - begun, deadline - begun, min(best, criterion))
                return interrupted.is_set()

            found = _one_start(problem, poses, solver, iterations, seed, (k, share), watch)
            best = min(best, found.criterion)
            yield found


def _one_start(
    problem: Problem,
    poses: Poses,
    solver: str,
    iterations: int | None,
    seed: int,
    item: tuple[int, float],
    watch: Callable[[float], bool] | None = None,
) -> Found:
    """Optimise from a random start of a number for some seconds."""
    number, seconds = item
    end = monotonic() + seconds
    with _interruptible(worker=True) if watch is None else nullcontext() as interrupted:

        def enough(criterion: float) -> bool:
            told = interrupted is not None and interrupted.is_set()
            told |= watch is not None and watch(criterion)
            return told or monotonic() > end

        start, near = feasible_start(problem, poses, seed, number)
        search = Search(problem, enough, start, near, most=iterations)
        stopped = search.run(SOLVERS[solver])
    trail = tuple(search.trail) or (start,)
    return Found(start, trail, search.criterion, search.evaluations, stopped)


@contextmanager
def _interruptible(worker: bool = False) -> Iterator[threading.Event]:
    """An event that Ctrl-C sets, here and in workers; a second Ctrl-C ends the program."""
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    before = signal.getsignal(signal.SIGINT)

    def stop(number: int, frame: FrameType | None) -> None:
        if event.is_set() and not worker:
            raise KeyboardInterrupt
        event.set()
        for child in active_children():
            if child.pid is not None:
                kill(child.pid, signal.SIGINT)

    signal.signal(signal.SIGINT, stop)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)
