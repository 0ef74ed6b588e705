"""Solvers of the optimisation problem: SciPy's SLSQP, and IPOPT where it is installed.

Both may leave the feasible set on their way, and both may be stopped at any time. The search keeps
the best feasible point that was seen.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import optional
from loopid.excitation.problem import Value
from loopid.excitation.search import Search, Stuck

# What stands for a criterion and bounds where the loops do not close.
OUT_OF_REACH = 1e3
# Relative change of the criterion that ends an optimisation.
CONVERGED = 1e-6
INFINITE = 1e19  # to IPOPT


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
    """The interior-point method of IPOPT [Waechter2006]: NaN stands for what is out of reach."""
    with optional("ipyopt", "excite"):
        import ipyopt
    watched, N, reason = search.watched, len(search.problem.time), list[BaseException]()
    lower, upper = (np.tile(end[watched], N) for end in search.problem.limits)
    n, m = len(start), len(lower)

    def value(y: FloatArray, slopes: bool = False) -> Value | None:
        try:
            return None if reason else search.value(np.array(y), slopes)
        except BaseException as error:  # IPOPT would lose it: it is raised at the end
            reason.append(error)
            return None

    def criterion(y: FloatArray) -> float:
        found = value(y)
        return np.nan if found is None else found.f

    def writing(part: Callable[[Value], FloatArray], slopes: bool) -> Callable[..., None]:
        def write(y: FloatArray, out: FloatArray) -> None:
            found = value(y, slopes)
            out[...] = np.nan if found is None else part(found)

        return write

    problem = ipyopt.Problem(
        n,
        np.full(n, -INFINITE),
        np.full(n, INFINITE),
        m,
        np.maximum(lower, -INFINITE),
        np.minimum(upper, INFINITE),
        np.divmod(np.arange(m * n), n),  # rows and columns of the Jacobian, which is dense
        (np.array([], int), np.array([], int)),
        criterion,
        writing(lambda found: found.df, True),
        writing(lambda found: found.g[:, watched].ravel(), False),
        writing(lambda found: found.dg.reshape(N, -1, n)[:, watched].ravel(), True),
        intermediate_callback=lambda *_: not reason,
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
    if reason:
        raise reason[0]
