"""Ties: how many choices are equally good, and which of them is taken.

Fewest terms come first, then the smallest coefficients, then the dependent columns that come first.
So the answer is unique, and the same for all searches that list ties.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np

from loopid.arguments import FloatArray, IntArray
from loopid.base_parameters.blocks import Block, Levels
from loopid.base_parameters.choice import SearchEffort
from loopid.base_parameters.structure import regrouping_matrix
from loopid.base_parameters.tree import Budget, OutOfBudgetError, selections_between

EQUAL_COEFFICIENTS = 1e-6  # sums of coefficients that differ by less are equal
BATCH = 1 << 22  # numbers in the regrouping matrices that are in memory together


@dataclass(frozen=True)
class Readability:
    """What makes a choice readable: few terms, small coefficients."""

    terms: int
    coefficients: float
    dependent: tuple[int, ...]

    def __add__(self, other: Readability) -> Readability:
        return Readability(
            self.terms + other.terms,
            self.coefficients + other.coefficients,
            tuple(sorted(self.dependent + other.dependent)),
        )


NOTHING = Readability(0, 0.0, ())


def most_readable(choices: Iterable[Readability]) -> Readability:
    """The first choice in the order of terms, coefficients and columns."""
    every = list(choices)
    terms = min(choice.terms for choice in every)
    every = [choice for choice in every if choice.terms == terms]
    enough = min(choice.coefficients for choice in every) + EQUAL_COEFFICIENTS
    every = [choice for choice in every if choice.coefficients <= enough]
    return min(every, key=lambda choice: choice.dependent)


def readabilities(
    null_basis: FloatArray, choices: IntArray, columns: IntArray | None = None
) -> Iterator[Readability]:
    """Readability of several choices (c, d) of rows of a null basis (n, d), one after another.

    ``columns`` (n,) are those that the rows belong to, if not 0 ... n - 1.
    """
    names = choices if columns is None else columns[choices]
    size = max(1, BATCH // null_basis.size)
    for start in range(0, len(choices), size):
        part = slice(start, start + size)
        beta = np.abs(regrouping_matrix(null_basis, choices[part]))
        terms, totals = (beta > 0).sum(axis=(1, 2)).tolist(), beta.sum(axis=(1, 2)).tolist()
        for count, total, own in zip(terms, totals, names[part].tolist(), strict=True):
            yield Readability(count, total, tuple(sorted(own)))


@dataclass(frozen=True)
class Tied:
    """Levels of the best joint selections, and the tolerance of their condition numbers."""

    levels: Sequence[Levels]
    tolerance: float

    @property
    def overlap(self) -> bool:
        """Whether a selection may keep to two of the levels, and would be counted twice.

        Its value is at most the smaller largest over the larger smallest, which is below the least
        value unless the levels nearly agree.
        """
        least = min(one.ratio for one in self.levels) * (1 - 2 * self.tolerance)
        return any(
            min(one.largest, other.largest) > least * max(one.smallest, other.smallest)
            for one, other in combinations(self.levels, 2)
        )


def most_readable_tie(
    blocks: Sequence[Block], tied: Tied, effort: SearchEffort, budget: Budget
) -> tuple[Readability, int | None, bool]:
    """The most readable of the best choices, how many there are, and whether some nearly tie.

    They are not counted where they are too many, or where some nearly tie.
    """
    choices, ties, near = [], 0, tied.overlap
    for levels in tied.levels:
        choice, ways = NOTHING, 1
        for block in blocks:
            selections, nearly = _listed(block, levels, tied.tolerance, effort, budget)
            near |= nearly
            if selections:
                ways *= sum(block.ways(own) for own in selections)
            else:
                ways, selections = 0, [_first(block, levels, tied.tolerance, budget)]
            dependent = block.dependent(np.array(selections))
            if len(dependent) * len(tied.levels) == 1:  # nothing to compare
                choice += Readability(0, 0.0, tuple(block.columns[dependent[0]].tolist()))
                continue
            batches = readabilities(block.null_basis, dependent, block.columns)
            choice += most_readable(budget.checking(batches))
        choices.append(choice)
        ties = ties + ways if ways and (ties or len(choices) == 1) else 0
    return most_readable(choices), None if near else ties or None, near


def _listed(
    block: Block, levels: Levels, tolerance: float, effort: SearchEffort, budget: Budget
) -> tuple[list[IntArray], bool]:
    """All selections that keep to the levels, and whether some nearly do; none if too many.

    What is within half of the tolerance keeps to them, what is beyond twice of it does not.
    Selections between are near ties, which round-off would decide.
    """
    if block.size == block.count:
        return [np.arange(block.size)], False
    part = budget.part(effort.tie_nodes)
    found = selections_between(block, *levels.box(2 * tolerance), part)
    try:
        listed = list(islice(found, effort.ties + 1))
    except OutOfBudgetError:
        budget.check()
        return [], False
    finally:
        budget.add(part)
    if len(listed) > effort.ties:
        return [], False
    kept = [own for own in listed if block.levels(own).inside(*levels.box(tolerance / 2))]
    return kept, len(kept) < len(listed)


def _first(block: Block, levels: Levels, tolerance: float, budget: Budget) -> IntArray:
    """The selection that keeps to the levels and makes the first columns dependent.

    Column after column is made dependent where some selection allows it: an answer that does not
    depend on how selections are found.
    """
    settled: tuple[list[int], list[int]] = ([], [])
    dependent, base = settled if block.selects_dependent else settled[::-1]

    def some(row: list[int]) -> IntArray | None:
        dependent.extend(row)
        taken, left = (np.array(rows, dtype=np.int64) for rows in settled)
        box = levels.box(tolerance)
        found = next(selections_between(block, *box, budget, taken, left), None)
        del dependent[len(dependent) - len(row) :]
        return found

    witness = some([])
    if witness is None:  # a selection with these levels is known
        raise OutOfBudgetError
    for row in range(block.size):
        if (row in witness) != block.selects_dependent:
            found = some([row])
            if found is None:
                base.append(row)
                continue
            witness = found
        dependent.append(row)
    return witness
