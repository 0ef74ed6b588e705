"""The fit as a semidefinite program, solved by Clarabel [Goulart2024].

    minimise ½‖r‖² + ½ xᵀ Q x + w Σ (tr X - Σ t)   with r = F x - g and t <= log diag(K),

where [I + X, K; Kᵀ, diag(K)] >= 0 for a lower triangular K makes Σ log diag(K) a lower bound of
log det(I + X), attained at its maximum.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from loopid.arrays import FloatArray
from loopid.consistency.problem import ConvexProblem
from loopid.consistency.pseudo_inertia import COLUMNS, DIAGONAL, IDENTITY, ROWS, SIZE, WIDTH
from loopid.errors import FeasibilityError, MissingExtraError

TOLERANCE = 1e-8  # of Clarabel: duality gap and residuals
# A solution that is almost within it counts where the duality gap proves the objective this well.
SOLVED, LARGEST_GAP = ("Solved", "AlmostSolved"), 1e-6
# Parts of the way to the start that bring a solution inside which is outside by the tolerance.
NUDGES = (1e-9, 1e-8, 1e-7, 1e-6)
LIFTED = WIDTH + SIZE  # unknowns K and t that the entropic part adds to a body


def solve(problem: ConvexProblem) -> FloatArray:
    """Unknowns (q,) of the least objective.

    Raises
    ------
    MissingExtraError
        Without Clarabel.
    FeasibilityError
        When Clarabel does not reach its tolerance.
    """
    try:
        import clarabel
    except ImportError as error:
        raise MissingExtraError("clarabel", "sdp") from error
    program = _Program(problem, clarabel)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    data = program.quadratic(), program.linear(), *program.constraints(), program.cones
    solution = clarabel.DefaultSolver(*data, settings).solve()
    gap = abs(solution.obj_val - solution.obj_val_dual)
    if str(solution.status) not in SOLVED or not gap <= LARGEST_GAP * (1 + abs(solution.obj_val)):
        raise FeasibilityError(
            f"Clarabel ends with {solution.status}, its objective certain to {gap:.1e} only: "
            "use the solver 'log-cholesky'"
        )
    return _inside(problem, np.array(solution.x[: program.size], dtype=np.float64))


def _inside(problem: ConvexProblem, unknowns: FloatArray) -> FloatArray:
    """The solution, or the nearest point towards the start that is strictly inside."""
    for part in (0.0, *NUDGES):
        inner = unknowns + part * (problem.whitening.start - unknowns)
        if problem.whitening.allows(inner):
            return inner
    raise FeasibilityError("Clarabel's solution is outside the constraints")


class _Program:
    """The program in Clarabel's form: A x + s = b with s in cones, unknowns x, r, then K and t."""

    def __init__(self, problem: ConvexProblem, clarabel: Any) -> None:
        self.problem, self.clarabel = problem, clarabel
        self.rows, self.size = problem.data.shape
        self.count = len(problem.whitening.prior.bodies)
        self.width = self.size + self.rows + (LIFTED * self.count if problem.entropic else 0)
        self.cones: list[Any] = []

    def quadratic(self) -> Any:
        from scipy.sparse import block_diag, csc_matrix, eye, triu

        rest = self.width - self.size - self.rows
        parts = [csc_matrix(self.problem.quadratic), eye(self.rows), csc_matrix((rest, rest))]
        return triu(block_diag(parts)).tocsc()

    def linear(self) -> FloatArray:
        costs = np.zeros(self.width)
        if self.problem.entropic:
            costs[: WIDTH * self.count] = np.tile(IDENTITY, self.count)
            lifted = costs[self.size + self.rows :].reshape(self.count, LIFTED)
            lifted[:, WIDTH:] = -1.0
        return self.problem.strength * costs

    def constraints(self) -> tuple[Any, FloatArray]:
        from scipy.sparse import coo_matrix, csc_matrix, vstack

        problem, cones = self.problem, self.clarabel
        data = np.hstack([problem.data, -np.eye(self.rows)])
        blocks, offsets = [self._padded(csc_matrix(data))], [problem.target]
        self.cones.append(cones.ZeroConeT(self.rows))
        if len(problem.whitening.levels):
            blocks.append(self._padded(csc_matrix(-problem.whitening.slopes)))
            offsets.append(problem.whitening.levels)
            self.cones.append(cones.NonnegativeConeT(len(problem.whitening.levels)))
        for k in range(self.count):
            entries, offset = self._lifted(k) if problem.entropic else self._plain(k)
            rows, columns, values = (np.array(part) for part in zip(*entries, strict=True))
            shape = len(offset), self.width
            blocks.append(coo_matrix((values, (rows, columns)), shape=shape).tocsc())
            offsets.append(offset)
        return vstack(blocks).tocsc(), np.concatenate(offsets)

    def _padded(self, matrix: Any) -> Any:
        from scipy.sparse import csc_matrix, hstack

        return hstack([matrix, csc_matrix((matrix.shape[0], self.width - matrix.shape[1]))])

    def _plain(self, k: int) -> tuple[list[tuple[int, int, float]], FloatArray]:
        """I + X >= 0."""
        self.cones.append(self.clarabel.PSDTriangleConeT(SIZE))
        return [(i, WIDTH * k + i, -1.0) for i in range(WIDTH)], IDENTITY

    def _lifted(self, k: int) -> tuple[list[tuple[int, int, float]], FloatArray]:
        """[I + X, K; Kᵀ, diag(K)] >= 0 and exp(t) <= diag(K)."""
        first = self.size + self.rows + LIFTED * k
        entries, offset = self._plain(k)
        self.cones[-1] = self.clarabel.PSDTriangleConeT(2 * SIZE)
        diagonals = np.flatnonzero(DIAGONAL).tolist()
        for i, (upper, lower) in enumerate(zip(ROWS.tolist(), COLUMNS.tolist(), strict=True)):
            # Entry (lower, upper) of K stands in row lower and column 4 + upper.
            place = _triangle(lower, SIZE + upper)
            entries.append((place, first + i, -np.sqrt(2.0)))
        for j, i in enumerate(diagonals):
            entries.append((_triangle(SIZE + j, SIZE + j), first + i, -1.0))
        cone = _triangle(0, 2 * SIZE)
        for j, i in enumerate(diagonals):
            entries.append((cone + 3 * j, first + WIDTH + j, -1.0))
            entries.append((cone + 3 * j + 2, first + i, -1.0))
            self.cones.append(self.clarabel.ExponentialConeT())
        exponentials = np.tile([0.0, 1.0, 0.0], SIZE)
        return entries, np.concatenate([offset, np.zeros(cone - WIDTH), exponentials])


def _triangle(row: int, column: int) -> int:
    """Place of an entry of the upper triangle, column by column."""
    return column * (column + 1) // 2 + row
