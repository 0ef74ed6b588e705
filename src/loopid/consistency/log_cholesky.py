"""The fit without a solver for semidefinite programs: log-Cholesky coordinates.

Every positive definite I + X is U Uᵀ with one triangular U, whose diagonal is exp of some numbers:
with the entries beside it, these are its log-Cholesky coordinates, and know no constraints
[Rucker2022]. But data that are straight in X curve in them, and a minimiser that holds on to them
crawls along thin bent valleys. So they are taken afresh around each iterate, where Newton's step
is, to first order, a straight line in X: the next factor is that of the point on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray
from loopid.consistency.newton import (
    Frame,
    Iterate,
    Target,
    find_frame,
    newton_direction,
    newton_step,
)
from loopid.consistency.problem import ConvexProblem
from loopid.consistency.pseudo_inertia import IDENTITY, SIZE

LAST_TARGET = 1e-8  # τ in the end, relative to the strength of the regularisation
REDUCTION = 0.1  # of τ in a step, where the last one was not cut short
STEPS = 200  # of which some 40 are used
SETTLING = 20  # of them at the last target, of which some three are used
SHORTEST = 1e-6  # a step cut to this part leads nowhere: nothing meets the constraints
NEAR = 2.0  # times w, below which the bodies of the entropic fit are at their target


@dataclass(frozen=True, eq=False)
class Solution:
    """Unknowns (q,), and whether the last step hardly moved them."""

    unknowns: FloatArray
    settled: bool


def solve(problem: ConvexProblem, start: FloatArray | None = None) -> Solution:
    """Unknowns (q,) of the least objective.

    Parameters
    ----------
    start : FloatArray, optional
        (q,), strictly inside the constraints.
    """
    iterate, length, left = _first(problem, start), 0.0, SETTLING
    end = LAST_TARGET * problem.strength
    for _ in range(STEPS):
        try:
            frame = find_frame(problem, iterate)
            target = _target(problem, iterate, frame, length)
            step = newton_step(problem, iterate, frame, target)
        except np.linalg.LinAlgError:  # round-off, where bodies are many orders apart
            break
        length = step.length()
        iterate = iterate.moved(frame, step, length)
        if target.slacks <= end and length == 1.0 and step.is_last(iterate.unknowns):
            return Solution(iterate.unknowns, True)
        left -= target.slacks <= end
        if left == 0 or length < SHORTEST:
            break
    return Solution(iterate.unknowns, False)


def _first(problem: ConvexProblem, start: FloatArray | None) -> Iterate:
    """The start with the multipliers that it would have as the solution, or a guess."""
    whitening = problem.whitening
    if start is None:
        x = _as_large_as_wanted(problem)
        slope = problem.data.T @ (problem.data @ x - problem.target) + problem.quadratic @ x
        size = max(float(np.abs(slope).max(initial=0.0)), problem.strength)
        S = np.tile(size * np.eye(SIZE), (len(whitening.prior.bodies), 1, 1))
    else:
        x, size = start, problem.strength
        S = np.asarray(size * np.linalg.inv(whitening.bodies(x)), dtype=np.float64)
    return Iterate(x, S, size / whitening.slacks(x))


def _as_large_as_wanted(problem: ConvexProblem) -> FloatArray:
    """Bodies (q,) that are all as much larger than the prior as the data want any to be."""
    x, inside = problem.whitening.start.copy(), problem.whitening.inside
    H = problem.quadratic + problem.strength * np.eye(len(x))
    residual = problem.data @ x - problem.target
    gradient, soft = problem.quadratic @ x, np.ones(len(residual))
    free = newton_direction(problem.data, residual, soft, gradient, H)
    largest = np.abs(free[:inside]).max(initial=0.0)
    x[:inside] = largest * np.tile(IDENTITY, len(problem.whitening.prior.bodies))
    return x


def _target(problem: ConvexProblem, iterate: Iterate, frame: Frame, length: float) -> Target:
    """τ of the next step: a part of what the products are now, unless the last was cut short."""
    squares = frame.diagonals.ravel() ** 2
    arrived = problem.entropic and squares.mean() <= NEAR * problem.strength
    products = frame.slacks * iterate.multipliers
    open_ones = products if arrived else np.concatenate([products, squares])
    mean = float(open_ones.mean()) if len(open_ones) else 0.0
    tau = max(max(REDUCTION, (1 - length) ** 2) * mean, LAST_TARGET * problem.strength)
    return Target(max(tau, problem.strength) if problem.entropic else tau, tau)
