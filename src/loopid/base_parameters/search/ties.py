"""Breaking ties: among equally good selections, the most readable regrouping.

Fewest terms first, then the smallest coefficients, then the dependent columns that come first:
the answer is unique, and does not depend on the strategy that found it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters.regrouping import regrouping_matrix

# Selections listed to choose among: of one part in exact search, of all in exhaustive search.
MOST_TIES = 20_000
# Sums of coefficients that differ by less than this are equal.
EQUAL_COEFFICIENTS = 1e-6


@dataclass(frozen=True, order=True)
class Readability:
    """Sort key of a choice: less is better."""

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


def most_readable(
    null_basis: FloatArray, choices: IntArray, columns: IntArray | None = None
) -> Readability:
    """The best of several choices.

    Parameters
    ----------
    null_basis : FloatArray
        (n, d), of all parameters or of one block.
    choices : IntArray
        (c, d), dependent rows of ``null_basis``.
    columns : IntArray, optional
        (n,), the columns that the rows belong to, if not 0 ... n - 1.
    """
    beta = np.abs(regrouping_matrix(null_basis, choices))
    terms, totals = (beta > 0).sum(axis=(1, 2)), beta.sum(axis=(1, 2))
    fewest = np.flatnonzero(terms == terms.min())
    smallest = totals[fewest].min() + EQUAL_COEFFICIENTS
    kept = fewest[totals[fewest] <= smallest]
    names = np.sort(choices[kept] if columns is None else columns[choices[kept]], axis=1)
    first = min(tuple(int(j) for j in dependent) for dependent in names)
    # Rounded, so that sums which are equal compare equal.
    return Readability(int(terms.min()), round(float(totals[fewest].min()), 5), first)
