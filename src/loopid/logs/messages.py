"""Rows in messages: the first few, and how many."""

from __future__ import annotations

from collections.abc import Sequence

from loopid.arrays import IntArray

MOST_NAMED = 5


def rows_text(rows: IntArray | Sequence[int]) -> str:
    """As in "rows 3, 4, 5 and 17 more"."""
    named = [str(int(row)) for row in rows[:MOST_NAMED]]
    more = f" and {len(rows) - MOST_NAMED} more" if len(rows) > MOST_NAMED else ""
    return f"row{'s' if len(rows) > 1 else ''} {', '.join(named)}{more}"
