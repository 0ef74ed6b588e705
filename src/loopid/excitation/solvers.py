"""Solvers of the optimisation problem: SciPy's SLSQP, and IPOPT where it is installed.

Both may leave the feasible set on their way, and both may be stopped at any time: the search keeps
the best feasible point that was seen.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import MissingExtraError
from loopid.excitation.problem import Value
from loopid.excitation.search import Search, Stuck

# What stands for a criterion and bounds where the loops do not close.
OUT_OF_REACH = 1e3
# Relative change of the criterion that ends an optimisation.
CONVERGED = 1e-6


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
        except BaseException as reason:  # IPOPT would lose it: it is raised below
            stopped.append(reason)
            value = None
        if value is None:
            if out is not None:
                out[...] = np.nan
            return np.nan
        return work(value)

    stopped: list[BaseException] = []
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
