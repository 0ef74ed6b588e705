"""Inverses of many matrices with the same sparsity, all eliminated in the same order.

Gauss-Jordan elimination with one order of pivots for all samples, chosen for large pivots and
little fill-in [Duff2017, ch. 7]. The order may not suit a sample: the error of each inverse is
measured, so that such a sample can be solved by other means.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.pivoting import Pivot, pivot_order

# Products (i, j, N) of matrices (i, k, N) and transposed ones (j, k, N): sums run over neighbours
# in memory.
PRODUCT = "ikn,jkn->ijn"


@dataclass(frozen=True)
class Step:
    """Pivots that are exchanged together, and what else is in their rows and columns.

    Attributes
    ----------
    pivots : IntArray
        (p, p), places in the flattened matrix of the pivots' rows at the pivots' columns.
    rows : IntArray
        (r, p), of other columns that these rows hold.
    columns : IntArray
        (c, p), of other rows that hold these columns.
    rest : IntArray
        (c, r), where those rows and columns meet.
    """

    pivots: IntArray
    rows: IntArray
    columns: IntArray
    rest: IntArray

    @classmethod
    def of(cls, pivots: list[Pivot]) -> Step:
        """Exchange pivots at once that fill in the same rows and columns."""
        n = len(pivots[0].row)
        i, j = (np.array([getattr(pivot, side) for pivot in pivots]) for side in ("i", "j"))
        other_columns = np.setdiff1d(np.flatnonzero(pivots[-1].row), j)
        other_rows = np.setdiff1d(np.flatnonzero(pivots[-1].column), i)
        return cls(
            i[:, None] * n + j,
            i * n + other_columns[:, None],
            other_rows[:, None] * n + j,
            other_rows[:, None] * n + other_columns,
        )


@dataclass(frozen=True)
class Elimination:
    """An order of n pivots.

    Attributes
    ----------
    steps : tuple of Step
    order : IntArray
        (n, n), where each entry of the inverse is in the flattened matrix after all steps.
    parity : float
        1 or -1, of the permutation from the pivots' rows to their columns.
    """

    steps: tuple[Step, ...]
    order: IntArray
    parity: float

    @classmethod
    def of(cls, typical: FloatArray) -> Elimination:
        """Choose the pivots on some typical matrices (n, n, k), zero wherever others may be."""
        n, pivots = len(typical), pivot_order(typical)
        # Once everything is filled in, larger steps touch the memory less often.
        filled = list(takewhile(lambda pivot: pivot.column.all(), reversed(pivots)))[::-1]
        groups = [[pivot] for pivot in pivots[: n - len(filled)]] + [filled]
        at_row = np.array([pivot.i for pivot in sorted(pivots, key=lambda pivot: pivot.j)])
        permutation = np.eye(n)[at_row]
        steps = tuple(Step.of(group) for group in groups if group)
        order = at_row[:, None] * n + np.argsort(at_row)
        return cls(steps, order, float(np.sign(np.linalg.det(permutation))))

    def inverses(self, matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Inverses (n, n, N) and the signs (N,) of the determinants.

        NaN or inaccurate where this order of pivots does not suit.
        """
        flat = matrices.reshape(-1, matrices.shape[2]).copy()
        signs = np.full(matrices.shape[2], self.parity)
        with np.errstate(all="ignore"):
            for step in self.steps:
                _exchange(flat, step, signs)
        return flat[self.order], signs


def inversion_error(matrices: FloatArray, inverses: FloatArray) -> FloatArray:
    """Error (N,) of inverses, relative to what they are applied to, as one vector shows it.

    X A w - w for a w without any pattern [Freivalds1977].
    """
    w = np.random.default_rng(0).standard_normal(len(matrices))
    images = np.einsum("ijn,j->in", matrices, w)
    errors = np.einsum("ijn,jn->in", inverses, images) - w[:, None]
    return np.asarray(np.sqrt(np.einsum("in,in->n", errors, errors) / (w @ w)))


def _exchange(flat: FloatArray, step: Step, signs: FloatArray) -> None:
    """Solve the pivots' rows of y = A x for their x in place, and put these into other rows."""
    inverse = flat[step.pivots]
    _invert(inverse, signs)
    columns = flat[step.columns]
    rows = np.einsum("jkn,ikn->ijn", inverse, flat[step.rows])
    flat[step.rest] -= np.einsum(PRODUCT, columns, rows)
    flat[step.columns] = np.einsum(PRODUCT, columns, inverse.transpose(1, 0, 2))
    flat[step.rows], flat[step.pivots] = -rows, inverse


def _invert(matrices: FloatArray, signs: FloatArray) -> None:
    """Invert small matrices (p, p, N) in place with pivots in their order, and turn the signs."""
    if len(matrices) == 1:
        signs *= np.sign(matrices[0, 0])
        np.reciprocal(matrices, out=matrices)
        return
    for k in range(len(matrices)):
        pivot = matrices[k, k].copy()
        signs *= np.sign(pivot)
        row, column = matrices[k] / pivot, matrices[:, k].copy()
        matrices -= column[:, None] * row
        matrices[:, k], matrices[k], matrices[k, k] = column / pivot, -row, 1.0 / pivot
