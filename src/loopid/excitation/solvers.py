"""Solvers of the optimisation problem: SciPy's SLSQP, and IPOPT where it is installed.

Both may leave the feasible set on their way, and both may be stopped at any time. The search keeps
the best feasible point that was seen.
"""

from __future__ import annotations

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
    """The interior-point method of IPOPT [Waechter2006]."""
    with optional("ipyopt", "excite"):
        import ipyopt
    callbacks, N = _Callbacks(search), len(search.problem.time)
    lower, upper = (np.tile(end[search.watched], N) for end in search.problem.limits)
    n, m = len(start), len(lower)
    problem = ipyopt.Problem(
        n,
        np.full(n, -INFINITE),
        np.full(n, INFINITE),
        m,
        np.maximum(lower, -INFINITE),
        np.minimum(upper, INFINITE),
        np.divmod(np.arange(m * n), n),  # rows and columns of the Jacobian, which is dense
        (np.array([], int), np.array([], int)),
        callbacks.criterion,
        callbacks.slope,
        callbacks.bounded,
        callbacks.slopes,
        intermediate_callback=lambda *_: callbacks.reason is None,
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
    if callbacks.reason is not None:
        raise callbacks.reason


class _Callbacks:
    """What IPOPT evaluates: NaN out of reach, and everywhere once there is a reason to end."""

    def __init__(self, search: Search) -> None:
        self.search, self.watched = search, search.watched
        self.reason: BaseException | None = None

    def value(self, y: FloatArray, slopes: bool) -> Value | None:
        try:
            return None if self.reason else self.search.value(np.array(y), slopes)
        except BaseException as reason:  # IPOPT would lose it: it is raised at the end
            self.reason = reason
            return None

    def criterion(self, y: FloatArray) -> float:
        value = self.value(y, slopes=False)
        return np.nan if value is None else value.f

    def slope(self, y: FloatArray, out: FloatArray) -> None:
        value = self.value(y, slopes=True)
        out[...] = np.nan if value is None else value.df

    def bounded(self, y: FloatArray, out: FloatArray) -> None:
        value = self.value(y, slopes=False)
        out[...] = np.nan if value is None else value.g[:, self.watched].ravel()

    def slopes(self, y: FloatArray, out: FloatArray) -> None:
        value = self.value(y, slopes=True)
        shape = len(self.search.problem.time), len(self.watched), len(y)
        out[...] = np.nan if value is None else value.dg.reshape(shape)[:, self.watched].ravel()
