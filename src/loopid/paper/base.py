"""The base parameters of the paper's robot beside the rows of its Table II."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from loopid.arrays import IntArray
from loopid.base_parameters import BaseParameters, find_base_parameters
from loopid.errors import SearchError
from loopid.paper.printed import PRINTED_DIGITS, TABLE_II
from loopid.regressors import structural_observation
from loopid.robot import Mechanism

TIMED_RUNS = 7


@dataclass(frozen=True)
class BaseComparison:
    """Base parameters of the paper's robot beside the paper's.

    Attributes
    ----------
    mechanism : Mechanism
    base : BaseParameters
    rows : tuple of int or None
        For each row of Table II the base parameter that equals it to the printed digits.
    seconds : float
        Median time from the triangular factor to the certified choice.
    """

    mechanism: Mechanism
    base: BaseParameters
    rows: tuple[int | None, ...]
    seconds: float

    @property
    def agrees(self) -> bool:
        """Whether every row of Table II was found."""
        return None not in self.rows

    @property
    def order(self) -> IntArray:
        """(15,), columns of the base parameters in the order of Table II."""
        return rows_of_table_ii(self.base)


def compare_base_parameters(mechanism: Mechanism) -> BaseComparison:
    """Find the base parameters of the 3UPS+RPU and match them with Table II."""
    observation = structural_observation(mechanism)
    base = find_base_parameters(observation)
    times = []
    for _ in range(TIMED_RUNS):
        start = perf_counter()
        find_base_parameters(observation)
        times.append(perf_counter() - start)
    rows = matching_rows(base)
    return BaseComparison(mechanism, base, rows, float(np.median(times)))


def _matching(base: BaseParameters, printed: dict[str, float]) -> int | None:
    for number, terms in enumerate(base.terms):
        if terms.keys() == printed.keys() and all(
            abs(terms[label] - printed[label]) <= PRINTED_DIGITS for label in terms
        ):
            return number
    return None


def matching_rows(base: BaseParameters) -> tuple[int | None, ...]:
    """For each row of Table II the base parameter that equals it to the printed digits."""
    return tuple(_matching(base, row) for row in TABLE_II)


def rows_of_table_ii(base: BaseParameters) -> IntArray:
    """Columns (15,) of base parameters in the order of Table II.

    Raises
    ------
    SearchError
        When a row is not among them.
    """
    rows = matching_rows(base)
    missing = [str(number) for number, row in enumerate(rows, start=1) if row is None]
    if missing:
        raise SearchError(f"rows {', '.join(missing)} of the paper's Table II were not found")
    return np.array(rows, dtype=np.int64)
