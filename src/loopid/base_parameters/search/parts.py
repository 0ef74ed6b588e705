"""Parts of a choice problem that can be searched apart, in both criteria."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters.blocks import independent_blocks
from loopid.base_parameters.regrouping import base_columns
from loopid.base_parameters.search.block import Block, make_block
from loopid.base_parameters.search.engines import Engine, engine_for
from loopid.base_parameters.search.problem import ChoiceProblem


@dataclass(frozen=True)
class Part:
    """Some columns of the problem, and the block of vectors to select among.

    Attributes
    ----------
    columns : IntArray
        (n,), columns of the problem, ascending.
    null_basis : FloatArray
        (n, d), null vectors of these columns only.
    block : Block
        Its own columns are positions in ``columns``.
    selects_dependent : bool
        Whether a selection means dependent parameters (``nullspace``) or base ones.
    """

    columns: IntArray
    null_basis: FloatArray
    block: Block
    selects_dependent: bool

    @cached_property
    def engine(self) -> Engine:
        """The search that suits the block."""
        return engine_for(self.block, null_vectors=self.selects_dependent)

    def dependent(self, selections: list[IntArray]) -> IntArray:
        """Positions (c, d) of the dependent columns for selections of representatives.

        Of columns that stand for each other the first becomes dependent.
        """
        groups = self.block.columns
        if self.selects_dependent:
            return np.array([sorted(groups[i][0] for i in chosen) for chosen in selections])
        kept = [[groups[i][-1] for i in chosen] for chosen in selections]
        return np.array([base_columns(len(self.columns), np.array(base)) for base in kept])

    def ways(self, selection: IntArray) -> int:
        """Choices that the selection stands for."""
        ways = 1
        for representative in selection:
            ways *= len(self.block.columns[representative])
        return ways


def separate(problem: ChoiceProblem) -> tuple[Part, ...]:
    """Split a problem into parts; columns without a null vector among them need no choice."""
    V2 = problem.structure.null_basis
    if problem.criterion == "regressor":
        everything = np.arange(problem.size)
        block = make_block(problem.vectors, everything)
        return (Part(everything, V2, block, selects_dependent=False),)
    blocks = (columns for columns in independent_blocks(V2) if np.linalg.norm(V2[columns]) > 0.5)
    return tuple(_null_space_part(V2, columns) for columns in blocks)


def _null_space_part(null_basis: FloatArray, columns: IntArray) -> Part:
    rows = null_basis[columns]
    # Singular values of these rows are 0 or 1: the ones are the null vectors of the block.
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    own = rows @ right[values > 0.5].T
    block = make_block(own, np.arange(len(columns)))
    return Part(columns, own, block, selects_dependent=True)
