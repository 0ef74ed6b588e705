"""The choice: which parameters become dependent, and what makes one choice better."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters.regrouping import base_columns
from loopid.base_parameters.structure import Structure
from loopid.errors import OptionError

# cond(V22), the paper's; and cond(W_B), the amplification of noise in the estimates.
CRITERIA = ("nullspace", "regressor")


@checked_fields
@dataclass(frozen=True)
class ChoiceProblem:
    """Choose d of n parameters to be dependent, so that the criterion is least.

    Both criteria ask for k of n vectors with the least condition number: ``nullspace`` selects
    the d rows of V2 that make V22, ``regressor`` the r columns of W that make W_B.

    Attributes
    ----------
    structure : Structure
    criterion : str
        One of ``CRITERIA``.
    """

    structure: Structure
    criterion: str = "nullspace"

    def __post_init__(self) -> None:
        if self.criterion not in CRITERIA:
            raise OptionError.unknown("criterion", self.criterion, CRITERIA)

    @property
    def size(self) -> int:
        """Number n of parameters with an effect."""
        return len(self.structure.columns)

    @property
    def dependent_count(self) -> int:
        """Number d of dependent parameters."""
        return self.size - self.structure.rank

    @property
    def candidates(self) -> int:
        """Number of combinations, C(n, d)."""
        return comb(self.size, self.dependent_count)

    @property
    def vectors(self) -> FloatArray:
        """The n vectors (n, k), k of which are to be selected, scaled to a largest of 1."""
        if self.criterion == "nullspace":
            return self.structure.null_basis
        columns = self.structure.row_factor.T
        return np.asarray(columns / np.linalg.norm(columns, 2), dtype=np.float64)

    def dependent(self, selections: IntArray) -> IntArray:
        """Dependent columns (c, d) of selections (c, k) of vectors."""
        if self.criterion == "nullspace":
            return np.sort(selections, axis=1)
        rest = [base_columns(self.size, selection) for selection in selections]
        return np.array(rest, dtype=np.int64).reshape(len(selections), self.dependent_count)

    def condition_number(self, dependent: IntArray) -> float:
        """The criterion's value for dependent columns (d,)."""
        chosen = np.asarray(dependent)
        if self.criterion == "regressor":
            chosen = base_columns(self.size, chosen)
        return condition_number(self.vectors[chosen])


def condition_number(matrix: FloatArray) -> float:
    """Largest over smallest singular value; 1 for an empty matrix, infinite for a singular one."""
    return float(condition_numbers(matrix[None])[0])


def condition_numbers(matrices: FloatArray) -> FloatArray:
    """Condition numbers (c,) of matrices (c, m, n)."""
    if 0 in matrices.shape[1:]:
        return np.ones(len(matrices))
    values = np.linalg.svd(matrices, compute_uv=False)
    largest, smallest = values[:, 0], values[:, -1]
    ratio = np.full(len(values), np.inf)
    np.divide(largest, smallest, out=ratio, where=smallest > 0)
    return ratio
