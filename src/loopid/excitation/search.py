"""The search for a motion: starts share evaluations, and only motions that pass the check count.

A solver goes on from each start. All that it does follows from the start and the number of
evaluations, so that more of them never give a worse motion; the clock, and Ctrl-C, only stop it.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import monotonic
from types import FrameType
from typing import TypeAlias

import numpy as np

from loopid.arguments import BoolArray, FloatArray
from loopid.excitation.checks import Check, check_motion
from loopid.excitation.options import SOLVERS, DesignOptions
from loopid.excitation.problem import Problem, Value, evaluate
from loopid.excitation.starts import Poses, feasible_start
from loopid.records import record
from loopid.registry import Registry

# Bounds that keep this distance at the start, in scales, are left out of the problem until they
# have been broken at so many points: most never matter, and each costs a row a sample.
DISTANT, PATIENCE = 0.35, 4
# A criterion that is better by so much is worth a check on the finer grid, which takes as long as
# an evaluation: one percent in a volume, or in a condition number.
WORTH_A_CHECK = 0.01
# Parts of a motion's size that are tried where the finer grid shows a broken bound.
SHRINKS = (1.0, 0.997, 0.99, 0.97, 0.9)
SHRINKS_TO_REST = (0.7, 0.5, 0.25, 0.1, 0.03, 0.01, 0.0)

# Called with the evaluations done, those in all, and the best criterion so far.
DesignProgress = Callable[[int, int, float], None]


class Broken(Exception):  # noqa: N818 (no error)
    """A bound that was left out matters."""


class Stuck(Exception):  # noqa: N818 (no error)
    """The solver cannot go on."""


class Stopped(Exception):  # noqa: N818 (no error)
    """There are no evaluations left, or no time."""


@record
class Found:
    """The best motion of a search.

    Attributes
    ----------
    start : FloatArray
        Variables (m, c) of the motion that the search began with.
    X : FloatArray
        Variables (m, c).
    criterion : float
    checks : tuple of Check
        All bounds on the finer grid.
    evaluations : int
    converged : bool
        Whether the solver ended by itself.
    """

    start: FloatArray
    X: FloatArray
    criterion: float
    checks: tuple[Check, ...]
    evaluations: int
    converged: bool


@dataclass
class Search:
    """The points that a solver asks for, each evaluated once, and the best ones.

    Attributes
    ----------
    best : FloatArray
        Variables (n,) of the best point that keeps all bounds on the grid of the design.
    reached, criterion
        Configurations (N, nq), and the criterion, there.
    home : FloatArray
        Variables (m, c) of standing in a pose.
    most : int
        Evaluations.
    watch : callable
        Told the evaluations done and the best criterion; answers whether to stop.
    near : FloatArray
        Configurations (N, nq) from which the next point is reached.
    X, checked, checks
        Variables (m, c) of the best motion that passes the check, its criterion, and the check.
    watched : BoolArray
        (k,), the bounds that the solver is told of.
    """

    problem: Problem
    best: FloatArray
    reached: FloatArray
    home: FloatArray
    most: int
    watch: Callable[[int, float], bool]
    criterion: float = np.inf
    evaluations: int = 0
    watched: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    X: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    checked: float = np.inf
    checks: tuple[Check, ...] = ()
    near: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    _looked_at: float = np.inf
    _missed: int = 0
    _at: dict[bytes, Value | None] = field(default_factory=dict)

    def run(self, solve: Solver) -> bool:
        """Let a solver work until it finds nothing better; whether it came that far.

        Solvers give up for many reasons: each goes on from the best point as long as that helps.
        """
        self._begin()
        before = np.inf
        try:
            while self.criterion < before - WORTH_A_CHECK:
                before, self.near, self._at = self.criterion, self.reached, {}
                try:
                    solve(self, self.best)
                except Broken:
                    before = np.inf
                except Stuck:
                    continue
        except Stopped:
            return False
        self._check(self.best, self.criterion, SHRINKS)
        return True

    def value(self, y: FloatArray, slopes: bool = False) -> Value | None:
        """Criterion and bounds at a point, with slopes if asked for; None out of reach."""
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
        for part in SHRINKS_TO_REST:
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


Solver: TypeAlias = Callable[[Search, FloatArray], None]
FOUND_SOLVERS: Registry[Solver] = Registry("solver", SOLVERS)


def search(
    problem: Problem,
    poses: Poses,
    options: DesignOptions,
    solver: str,
    progress: DesignProgress | None = None,
) -> Found:
    """The best motion of all starts, one after the other; the first one begins in any case.

    A start that converges leaves the rest of its evaluations to those after it.
    """
    found, spent = list[Found](), 0
    end = np.inf if options.time_limit is None else monotonic() + options.time_limit
    with _interrupted() as interrupted:

        def watch(evaluations: int, criterion: float) -> bool:
            if progress is not None:
                best = min([criterion, *(each.criterion for each in found)])
                progress(spent + evaluations, options.evaluations, best)
            return interrupted.is_set() or monotonic() > end

        home = np.outer(problem.shape.still(), poses.positions[0])
        for number in range(options.starts):
            if found and watch(0, np.inf):
                break
            y, near = feasible_start(problem, poses, options.seed, number)
            share = (options.evaluations - spent) // (options.starts - number)
            one = Search(problem, y, near, home, share, watch)
            converged = one.run(FOUND_SOLVERS[solver])
            spent += one.evaluations
            start = problem.variables(y)
            found.append(Found(start, one.X, one.checked, one.checks, one.evaluations, converged))
    best = min(found, key=lambda each: each.criterion)
    converged = len(found) == options.starts and all(each.converged for each in found)
    return Found(best.start, best.X, best.criterion, best.checks, spent, converged)


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
