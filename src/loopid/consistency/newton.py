"""Newton's step of the log-Cholesky solver, in coordinates of the iterate's own.

Along with X go multipliers S of positive definiteness and l of the slacks. A step aims at X S = τ
and slack times l = τ, with τ going to zero; for the bodies of the entropic fit to its weight w,
where S = w (I + X)⁻¹ is what -w log det asks for. In the coordinates Y in which I + X and S are the
same diagonal V [Nesterov1997], I + X + dX = N (V + Y) Nᵀ, S changes by τ V⁻¹ - V - Y: the bodies'
part of the Hessian is the identity, however close to the boundary they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from loopid.arrays import FloatArray
from loopid.consistency.problem import ConvexProblem
from loopid.consistency.pseudo_inertia import IDENTITY, SIZE, WIDTH, congruence, matrix, vector

TO_THE_EDGE = 0.95  # of the way to the boundary that a step may go
CONVERGED = 1e-7  # last step, relative to one and to the largest unknown
CENTRED = 1e-2  # last step, relative to the distances from the boundary


@dataclass(frozen=True)
class Target:
    """τ of the bodies and of the slacks."""

    bodies: float
    slacks: float


@dataclass(frozen=True, eq=False)
class Frame:
    """Coordinates Y around an iterate in which I + X and S are the same diagonal.

    Attributes
    ----------
    factors : FloatArray
        N (bodies, 4, 4).
    diagonals : FloatArray
        V (bodies, 4).
    local : FloatArray
        (q, q), changes of the unknowns per unit of Y and of the joint terms.
    slacks : FloatArray
        (k,).
    """

    factors: FloatArray
    diagonals: FloatArray
    local: FloatArray
    slacks: FloatArray


@dataclass(frozen=True, eq=False)
class Step:
    """Directions of I + X, S, slacks and multipliers, relative to these, and of the unknowns."""

    bodies: FloatArray
    body_multipliers: FloatArray
    slacks: FloatArray
    multipliers: FloatArray
    unknowns: FloatArray

    def length(self) -> float:
        """How far the step may go, at most 1."""
        lowest = min(
            np.linalg.eigvalsh(self.bodies).min(initial=0.0),
            np.linalg.eigvalsh(self.body_multipliers).min(initial=0.0),
            self.slacks.min(initial=0.0),
            self.multipliers.min(initial=0.0),
        )
        return float(min(1.0, TO_THE_EDGE / -lowest)) if lowest < 0 else 1.0

    def is_last(self, unknowns: FloatArray) -> bool:
        """Whether hardly anything moves."""
        relative = max(np.abs(self.bodies).max(initial=0.0), np.abs(self.slacks).max(initial=0.0))
        moved, size = np.abs(self.unknowns).max(), 1 + np.abs(unknowns).max()
        return bool(relative <= CENTRED and moved <= CONVERGED * size)


@dataclass(frozen=True, eq=False)
class Iterate:
    """Unknowns (q,), multipliers S (bodies, 4, 4) of bodies and (k,) of slacks."""

    unknowns: FloatArray
    body_multipliers: FloatArray
    multipliers: FloatArray

    def moved(self, frame: Frame, step: Step, length: float) -> Iterate:
        """The iterate a part of a step further."""
        scaled = np.sqrt(frame.diagonals)[..., None] * np.linalg.inv(frame.factors)
        relative = np.eye(SIZE) + length * step.body_multipliers
        return Iterate(
            self.unknowns + length * step.unknowns,
            np.swapaxes(scaled, -1, -2) @ relative @ scaled,
            self.multipliers * (1 + length * step.multipliers),
        )


def find_frame(problem: ConvexProblem, iterate: Iterate) -> Frame:
    """The frame of an iterate.

    Raises
    ------
    LinAlgError
        Where round-off has put the iterate outside.
    """
    U = np.linalg.cholesky(problem.whitening.bodies(iterate.unknowns))
    squares, E = np.linalg.eigh(np.swapaxes(U, -1, -2) @ iterate.body_multipliers @ U)
    slacks = problem.whitening.slacks(iterate.unknowns)
    if squares.min(initial=1.0) <= 0 or slacks.min(initial=1.0) <= 0:
        raise np.linalg.LinAlgError
    N = U @ E * squares[:, None, :] ** -0.25
    local = np.eye(len(iterate.unknowns))
    for k, block in enumerate(congruence(N)):
        local[WIDTH * k : WIDTH * (k + 1), WIDTH * k : WIDTH * (k + 1)] = block
    return Frame(N, np.sqrt(squares), local, slacks)


def newton_step(problem: ConvexProblem, iterate: Iterate, frame: Frame, target: Target) -> Step:
    """Newton's direction towards a target.

    Raises
    ------
    LinAlgError
        Where round-off has the last word.
    """
    v, first = frame.diagonals, problem.whitening.faces
    A = problem.whitening.slopes @ frame.local
    gradient, H = _model(problem, iterate, frame, target)
    weights, pushes = iterate.multipliers / frame.slacks, target.slacks / frame.slacks
    gradient -= A[first:].T @ pushes[first:]
    H += (weights[first:, None] * A[first:]).T @ A[first:]
    # Faces of regions count as data: where a multiplier is large they are as stiff.
    roots = np.sqrt(weights[:first])
    residual = problem.data @ iterate.unknowns - problem.target
    y = newton_direction(
        np.concatenate([problem.data @ frame.local, roots[:, None] * A[:first]]),
        np.concatenate([residual, -pushes[:first] / roots]),
        np.concatenate([np.full(len(residual), float(not problem.exact)), np.ones(first)]),
        gradient,
        H,
    )
    Y = matrix(y[: problem.whitening.inside].reshape(-1, WIDTH))
    relative = 1 / np.sqrt(v[:, :, None] * v[:, None, :])
    slacks = A @ y / frame.slacks
    return Step(
        bodies=Y * relative,
        body_multipliers=(_diagonal(target.bodies / v - v) - Y) * relative,
        slacks=slacks,
        multipliers=target.slacks / (frame.slacks * iterate.multipliers) - 1 - slacks,
        unknowns=frame.local @ y,
    )


def _model(
    problem: ConvexProblem, iterate: Iterate, frame: Frame, target: Target
) -> tuple[FloatArray, FloatArray]:
    """Gradient (q,) and Hessian (q, q) in Y of the regularisation and of the bodies' barrier."""
    inside, local = problem.whitening.inside, frame.local
    gradient = local.T @ (problem.quadratic @ iterate.unknowns)
    if problem.entropic:
        traces = np.tile(IDENTITY, len(problem.whitening.prior.bodies))
        gradient += problem.strength * local[:inside].T @ traces
    gradient[:inside] -= vector(_diagonal(target.bodies / frame.diagonals)).ravel()
    H = local.T @ problem.quadratic @ local
    H[np.arange(inside), np.arange(inside)] += 1.0
    return gradient, H


def newton_direction(
    B: FloatArray, residual: FloatArray, softness: FloatArray, gradient: FloatArray, H: FloatArray
) -> FloatArray:
    """Minimiser of ½‖B y + ρ‖² + gᵀ y + ½ yᵀ H y, with B y + ρ = 0 in rows of softness 0.

    Found through the multipliers of the rows, which may be far stiffer than H.
    """
    factor = np.linalg.cholesky(H)
    rows = solve_triangular(factor, B.T, lower=True)
    reduced = solve_triangular(factor, gradient, lower=True)
    inner = rows.T @ rows + np.diag(softness)
    multipliers = cho_solve(cho_factor(inner), residual - rows.T @ reduced)
    direction = solve_triangular(factor, -(reduced + rows @ multipliers), lower=True, trans=1)
    return np.asarray(direction, dtype=np.float64)


def _diagonal(entries: FloatArray) -> FloatArray:
    return np.asarray(entries[..., None] * np.eye(SIZE), dtype=np.float64)
