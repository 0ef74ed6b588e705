"""The semidefinite programs, solved by Clarabel [Goulart2024].

log det is not a cone of Clarabel's. With a lower triangular K,

    [1 + X, K; Kᵀ, diag K] >= 0  and  t_i <= log K_ii

make Σ t a lower bound of log det(1 + X), attained at its maximum.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from loopid.arrays import FloatArray
from loopid.consistency.whitening import (
    COLUMNS,
    IDENTITY,
    ROWS,
    WIDTH,
    ConvexProblem,
    Whitening,
    matrix,
)
from loopid.errors import FeasibilityError, MissingExtraError

TOLERANCE = 1e-10  # of Clarabel: duality gap and residuals
# A solution that is almost within it counts where the duality gap proves the objective this well.
SOLVED, LARGEST_GAP = ("Solved", "AlmostSolved"), 1e-6
# So deep inside the constraints solutions are looked for, relative to the prior: far deeper than
# what Clarabel leaves open, so that no verdict hangs on round-off. Equations count as satisfiable
# where they are at twice this depth.
DEPTH = 1e-6
ROUND_OFF = 1e-12  # of equations whose rows and targets are of size one
Block = tuple[slice, FloatArray]  # unknowns, and what they are multiplied by


def minimise(problem: ConvexProblem, exact: bool = False, refuse: bool = True) -> FloatArray:
    """Unknowns (q,) of the least objective, strictly inside all constraints.

    Parameters
    ----------
    exact : bool
        Whether the data are met exactly, F x = g, instead of in the least-squares sense; see
        ``attainable``.
    refuse : bool
        Whether a solution short of the tolerance is refused: it will do for a message.

    Raises
    ------
    MissingExtraError
        Without Clarabel.
    FeasibilityError
        When Clarabel does not reach its tolerance.
    """
    whitening, (r, q) = problem.whitening, problem.data.shape
    program = _Program()
    x = program.unknowns(q)
    program.add_cost(x, quadratic=problem.quadratic)
    if exact:
        program.require("Zero", problem.target, (x, problem.data))
    else:
        misfit = program.unknowns(r)
        program.add_cost(misfit, quadratic=np.eye(r))
        program.require("Zero", problem.target, (x, problem.data), (misfit, -np.eye(r)))
    program.require_inside(whitening, DEPTH)
    for k in range(len(whitening.prior.bodies) if problem.entropic else 0):
        X, K, t = _body(k), program.unknowns(WIDTH), program.unknowns(4)
        program.add_cost(X, problem.strength * IDENTITY)
        program.add_cost(t, np.full(4, -problem.strength))
        program.require("PSDTriangle", LIFTED @ IDENTITY, (X, -LIFTED), (K, -LIFTED_FACTOR))
        for j, diagonal in enumerate(np.flatnonzero(IDENTITY)):
            log, bound = np.zeros((3, 4)), np.zeros((3, WIDTH))
            log[0, j] = bound[2, diagonal] = -1.0
            program.require("Exponential", np.array([0.0, 1.0, 0.0]), (t, log), (K, bound))
    solution = program.solution()
    gap = abs(solution.obj_val - solution.obj_val_dual)
    found = np.array(solution.x[x])
    if exact:
        found = _projected(found, problem.data, problem.target)
    solved = str(solution.status) in SOLVED and gap <= LARGEST_GAP * (1 + abs(solution.obj_val))
    if refuse and not (solved and whitening.depth(found) > 0):
        raise FeasibilityError(
            f"the consistent parameters do not converge: Clarabel ends with {solution.status}, its "
            f"objective certain to {gap:.1e} only: raise the strength of the prior, or the margin"
        )
    return found


def attainable(whitening: Whitening, data: FloatArray, target: FloatArray) -> bool:
    """Whether unknowns strictly inside all constraints satisfy F x = g, rows of size one.

    The least such unknowns prove it: they satisfy the equations to round-off and are inside.
    """
    program = _Program()
    x = program.unknowns(data.shape[1])
    program.add_cost(x, quadratic=np.eye(data.shape[1]))
    program.require("Zero", target, (x, data))
    program.require_inside(whitening, 2 * DEPTH)
    found = _projected(np.array(program.solution().x[x]), data, target)
    satisfied = np.abs(data @ found - target).max(initial=0.0) <= ROUND_OFF
    return bool(satisfied and whitening.depth(found) > DEPTH)


def _projected(unknowns: FloatArray, data: FloatArray, target: FloatArray) -> FloatArray:
    """The nearest unknowns (q,) that meet the data to round-off."""
    inverse = np.linalg.pinv(data)
    for _ in range(2):  # the second time refines the first
        unknowns = unknowns + inverse @ (target - data @ unknowns)
    return unknowns


class _Program:
    """Minimise ½ zᵀ P z + cᵀ z where b - A z lies in cones: collected block by block."""

    def __init__(self) -> None:
        self.size = 0
        self.costs: list[tuple[slice, FloatArray | None, FloatArray | None]] = []
        self.rows: list[tuple[str, FloatArray, tuple[Block, ...]]] = []

    def unknowns(self, count: int) -> slice:
        """Places of new unknowns."""
        self.size += count
        return slice(self.size - count, self.size)

    def add_cost(
        self,
        place: slice,
        linear: FloatArray | None = None,
        quadratic: FloatArray | None = None,
    ) -> None:
        self.costs.append((place, linear, quadratic))

    def require(self, cone: str, offset: FloatArray, *blocks: Block) -> None:
        """Demand that the offset less the blocks times their unknowns lies in a cone."""
        if len(offset):
            self.rows.append((cone, offset, blocks))

    def require_inside(self, whitening: Whitening, depth: float) -> None:
        """Demand the constraints of a whitening, with some room."""
        x = slice(0, whitening.map.shape[1])
        self.require("Nonnegative", whitening.levels - depth, (x, -whitening.slopes))
        for k in range(len(whitening.prior.bodies)):
            self.require("PSDTriangle", (1 - depth) * IDENTITY, (_body(k), -np.eye(WIDTH)))

    def solution(self) -> Any:
        try:
            import clarabel
        except ImportError as error:
            raise MissingExtraError("clarabel", "sdp") from error
        from scipy.sparse import csc_matrix

        P, c = np.zeros((self.size, self.size)), np.zeros(self.size)
        for place, linear, quadratic in self.costs:
            P[place, place] += 0.0 if quadratic is None else np.triu(quadratic)
            c[place] += 0.0 if linear is None else linear
        b = np.concatenate([offset for _, offset, _ in self.rows])
        A, first, cones = np.zeros((len(b), self.size)), 0, []
        for name, offset, blocks in self.rows:
            for place, block in blocks:
                A[first : first + len(offset), place] = block
            first += len(offset)
            cones.append(_cone(clarabel, name, len(offset)))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
        solver = clarabel.DefaultSolver(csc_matrix(P), c, csc_matrix(A), b, cones, settings)
        return solver.solve()


def _body(k: int) -> slice:
    return slice(WIDTH * k, WIDTH * (k + 1))


def _cone(clarabel: Any, name: str, rows: int) -> Any:
    if name == "Exponential":
        return clarabel.ExponentialConeT()
    if name == "PSDTriangle":
        return clarabel.PSDTriangleConeT(int(np.sqrt(2 * rows)))
    return getattr(clarabel, f"{name}ConeT")(rows)


def _lifted(corner: FloatArray, beside: FloatArray, below: FloatArray) -> FloatArray:
    """The matrix [corner, beside; ., below] (8, 8) as a vector (36,), as ``whitening.vector``."""
    whole = np.block([[corner, beside], [beside.T, below]])
    columns, rows = np.tril_indices(8)
    return np.asarray(whole[rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0)))


# The cone [1 + X, K; Kᵀ, diag K] by X (36, 10), and by the lower triangle of K (36, 10).
LIFTED = np.column_stack(
    [_lifted(unit, np.zeros((4, 4)), np.zeros((4, 4))) for unit in matrix(np.eye(WIDTH))]
)
LIFTED_FACTOR = np.column_stack(
    [
        _lifted(np.zeros((4, 4)), unit, np.diag(np.diag(unit)))
        for row, column in zip(COLUMNS, ROWS, strict=True)
        for unit in [np.outer(np.eye(4)[row], np.eye(4)[column])]
    ]
)
