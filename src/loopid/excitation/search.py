"""Starts that keep all bounds, and the searches from them until the time is up.

A start is a random motion, shrunk around a pose that keeps all bounds.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children
from os import kill
from time import monotonic
from types import FrameType

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import AssemblyError
from loopid.excitation.problem import Problem, evaluate
from loopid.excitation.solvers import SOLVERS, Search
from loopid.kinematics import measured_coordinates, singularity_measure, try_assemble
from loopid.robot import Mechanism
from loopid.workers import ordered_map

# How many of the best random poses are improved, how often, and how: by steps of a part of
# the workspace that gets smaller.
BEST, ROUNDS, SMALLER = 8, 14, 0.75
# Random motions for a start, and by how much they are shrunk until they keep all bounds.
DRAWS, SHRINK, SHRINKS = 3, 0.8, 40


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses in which all bounds hold, the one with most slack first.

    Attributes
    ----------
    positions : FloatArray
        (P, c), of the coordinates of the design.
    configurations : FloatArray
        (P, nq).
    reach : FloatArray
        (c,), half the range of each coordinate.
    """

    positions: FloatArray
    configurations: FloatArray
    reach: FloatArray


def slacks(problem: Problem, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slacks (N, k) of all bounds at rest in poses (N, c), and configurations (N, nq).

    Minus infinity where the loops do not close, or at a singularity.
    """
    space, found = problem.coordinates, np.full((len(positions), len(problem.bounds.all)), -np.inf)
    names = "platform" if space.on_platform else space.names
    outcome = try_assemble(space.mechanism, positions, names, shortest_step=2.0**-6)
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
    """Poses that keep all bounds, from random configurations (N, nq) on.

    Raises
    ------
    AssemblyError
        Naming the bound that no pose keeps.
    """
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
