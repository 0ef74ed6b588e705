"""Arrays of many rows, worked on block by block so that no temporary array is as large as they."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

BLOCK_ROWS = 4096


def row_blocks(rows: int | slice, size: int | None = None) -> Iterator[slice]:
    """The rows, or so many from 0 on, in blocks."""
    whole = slice(0, rows) if isinstance(rows, int) else rows
    step = BLOCK_ROWS if size is None else size
    for first in range(whole.start, whole.stop, step):
        yield slice(first, min(first + step, whole.stop))


def mapped_rows(function: Callable[[slice], NDArray[Any]], count: int) -> NDArray[Any]:
    """What a function makes of each block of rows, read-only."""
    whole = np.concatenate([function(rows) for rows in row_blocks(count)])
    whole.setflags(write=False)
    return whole


def spooled(blocks: Iterable[NDArray[Any]]) -> NDArray[Any]:
    """One read-only array of rows that come block by block, at least one."""
    whole = np.concatenate(list(blocks))
    whole.setflags(write=False)
    return whole


def empty_columns(count: int, width: int) -> NDArray[np.float64]:
    """A writable array (N, k), stored column after column."""
    return np.empty((width, count)).T


class Spool:
    """Rows that are appended, and then read as one array."""

    def __init__(self) -> None:
        self._blocks: list[NDArray[Any]] = []

    def __len__(self) -> int:
        return sum(map(len, self._blocks))

    def append(self, rows: ArrayLike) -> None:
        """Add rows (L, ...); all have the shape and type of the first."""
        self._blocks.append(np.array(rows, order="C"))

    def array(self) -> NDArray[Any]:
        """All rows, read-only."""
        return spooled(self._blocks)
