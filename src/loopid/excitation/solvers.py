"""Constrained optimisation by libraries: IPOPT where it is installed, SciPy's SLSQP elsewhere.

Both may leave the feasible set on their way, and both may be stopped at any time: what counts is
the best feasible point that was seen, and every start is one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import MissingExtraError
from loopid.excitation.problem import Problem, Value, evaluate

# What stands for a criterion and bounds where the loops do not close.
OUT_OF_REACH = 1e3
# Relative change of the criterion that ends an optimisation.
CONVERGED = 1e-6

# Called with the best criterion so far; answers whether to stop.
Watch = Callable[[float], bool]


# Bounds that keep this distance at the start, in scales, are left out of the problem until they
# have been broken at so many points: most never matter, and each costs a row a sample.
DISTANT, PATIENCE = 0.35, 4


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
        raise MissingExtraError("ipyopt", "excite") from error
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
