"""Breaking ties: among equally good selections, the most readable regrouping.

Fewest terms first, then the smallest coefficients, then the dependent columns that come first:
the answer is unique, and does not depend on the strategy that found it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters.regrouping import regrouping_matrix

# Sums of coefficients that differ by less than this are equal.
EQUAL_COEFFICIENTS = 1e-6
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
) -> list[Readability]:
    """Readability of several choices.

    Parameters
    ----------
    null_basis : FloatArray
        (n, d), of all parameters or of one block.
    choices : IntArray
        (c, d), dependent rows of ``null_basis``.
    columns : IntArray, optional
        (n,), the columns that the rows belong to, if not 0 ... n - 1.
    """
    names = choices if columns is None else columns[choices]
    size = max(1, BATCH // null_basis.size)
    terms, totals = [], []
    for start in range(0, len(choices), size):
        beta = np.abs(regrouping_matrix(null_basis, choices[start : start + size]))
        terms += (beta > 0).sum(axis=(1, 2)).tolist()
        totals += beta.sum(axis=(1, 2)).tolist()
    return [
        Readability(count, total, tuple(sorted(own)))
        for count, total, own in zip(terms, totals, names.tolist(), strict=True)
    ]
