"""Many starts, one after the other or in processes, until the time is up or somebody stops them."""

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
from loopid.excitation.problem import Problem
from loopid.excitation.solvers import SOLVERS, Search
from loopid.excitation.start import Poses, feasible_start
from loopid.workers import ordered_map

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
