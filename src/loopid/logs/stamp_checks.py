"""Time stamps that are none, or in another unit than they are said to be."""

from __future__ import annotations

from loopid.arrays import IntArray
from loopid.errors import LogError
from loopid.logs.messages import rows_text
from loopid.order_statistics import median
from loopid.scratch import rows_where, steps

# Median steps (s) that a log may have: others mean that the unit of the time is another.
SHORTEST_STEP, LONGEST_STEP = 1e-5, 0.2
OTHER_UNITS = (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9)


def check_stamps(source: str, rows: IntArray, stamps: IntArray) -> None:
    """Refuse stamps (R,) in ns that do not increase, or too fast or slowly for a log.

    Raises
    ------
    LogError
        Naming the rows, or the factor that would fit.
    """
    count = len(stamps) - 1
    wrong = rows_where(lambda block: steps(stamps, block) <= 0, count)
    if len(wrong):
        same = int((stamps[wrong + 1] == stamps[wrong]).sum())
        raise LogError(
            f"{source}: time must increase from row to row, but goes back {len(wrong) - same} "
            f"times and stands still {same} times, in {rows_text(rows[wrong + 1])}"
        )
    step = median(lambda block: steps(stamps, block), count) / 1e9
    if not _fits(step):
        factors = [f"{factor:g}" for factor in OTHER_UNITS if _fits(step * factor)]
        advice = f"; times {' or '.join(factors)} it would fit" if factors else ""
        raise LogError(
            f"{source}: the median step between time stamps is {step:.3g} s, but must be from "
            f"{SHORTEST_STEP:g} to {LONGEST_STEP:g} s: give the unit of the time in a mapping"
            f"{advice}"
        )


def _fits(step: float) -> bool:
    return SHORTEST_STEP <= step <= LONGEST_STEP
