"""Joint states as tables: messages that hold the same columns, in whatever order, are one table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import compress
from typing import Any

import numpy as np

from loopid import scratch
from loopid.arrays import FloatArray, IntArray
from loopid.errors import LogError
from loopid.logs.table import LARGEST_STAMP, NO_STAMP
from loopid.scratch import Spool

QUANTITIES = ("position", "velocity", "effort")
# Sets of columns that the messages of a topic may have; more are no robot's.
MOST_LAYOUTS = 256


@dataclass(frozen=True)
class Layout:
    """Messages of a topic that hold the same columns.

    Attributes
    ----------
    columns : tuple of str
        As in "elbow.effort", sorted.
    numbers : IntArray
        (R,), which of all messages of the topic they are, from 1.
    stamps, received : IntArray
        (R,) in ns, as the header says and as it was recorded; ``NO_STAMP`` for impossible ones.
    values : FloatArray
        (R, k).
    stamped : bool
        Whether any header has a time.
    """

    columns: tuple[str, ...]
    numbers: IntArray
    stamps: IntArray
    received: IntArray
    values: FloatArray
    stamped: bool


class JointStates:
    """The messages of a topic, sorted by the columns that they hold.

    Parameters
    ----------
    source : str
        The topic, for messages.
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._layouts: dict[tuple[str, ...], _Rows] = {}
        self.count = 0

    def append(self, state: Any, received: int) -> None:
        """Add a message.

        Raises
        ------
        LogError
            When its joints and values do not belong together.
        """
        self.count += 1
        parts = [getattr(state, quantity) for quantity in QUANTITIES]
        filled = tuple(len(part) > 0 for part in parts)
        columns, order = _columns(tuple(state.name), filled)
        values = np.concatenate([*compress(parts, filled), ()])
        if len(values) != len(order) or len(set(columns)) < len(columns):
            raise LogError(
                f"{self._source}: message {self.count} has {len(values)} values for "
                f"{len(set(columns))} columns, from {len(state.name)} joints"
            )
        if columns:
            stamp = state.header.stamp
            marks = self.count, _stamp(stamp.sec, stamp.nanosec), _stamp(0, received)
            self._layout(columns).append(marks, values[order])
        if self.count % scratch.BLOCK_ROWS == 0:
            for rows in self._layouts.values():
                rows.flush()

    def layouts(self) -> list[Layout]:
        """All messages, by the columns that they hold."""
        return [rows.layout(columns) for columns, rows in self._layouts.items()]

    def _layout(self, columns: tuple[str, ...]) -> _Rows:
        if columns not in self._layouts:
            if len(self._layouts) == MOST_LAYOUTS:
                raise LogError(
                    f"{self._source}: its messages hold more than {MOST_LAYOUTS} different sets "
                    "of joints"
                )
            self._layouts[columns] = _Rows()
        return self._layouts[columns]


class _Rows:
    """Rows of a layout, of which those that wait to be put into files are in memory."""

    def __init__(self) -> None:
        self._waiting: list[tuple[tuple[int, int, int], FloatArray]] = []
        self._spools = Spool(), Spool()
        self._stamped = False

    def append(self, marks: tuple[int, int, int], values: FloatArray) -> None:
        self._waiting.append((marks, values))
        self._stamped |= marks[1] != 0

    def flush(self) -> None:
        if self._waiting:
            marks, values = zip(*self._waiting, strict=True)
            self._spools[0].append(np.array(marks, dtype=np.int64))
            self._spools[1].append(np.array(values, dtype=np.float64))
            self._waiting = []

    def layout(self, columns: tuple[str, ...]) -> Layout:
        self.flush()
        marks, values = (spool.array() for spool in self._spools)
        numbers, stamps, received = marks.T
        return Layout(columns, numbers, stamps, received, values, self._stamped)


@lru_cache(maxsize=1024)
def _columns(joints: tuple[str, ...], filled: tuple[bool, ...]) -> tuple[tuple[str, ...], IntArray]:
    """Sorted columns of a message, and where their values stand in it."""
    names = [f"{joint}.{what}" for what in compress(QUANTITIES, filled) for joint in joints]
    order = sorted(range(len(names)), key=names.__getitem__)
    return tuple(names[k] for k in order), np.array(order, dtype=np.int64)


def _stamp(seconds: int, nanoseconds: int) -> int:
    stamp = int(seconds) * 10**9 + int(nanoseconds)
    return stamp if 0 <= stamp <= LARGEST_STAMP else int(NO_STAMP)
