"""Arrays of many rows in a small memory: what is large lies in a temporary file.

Such an array is an ordinary NumPy array whose pages the system fetches from the file when they are
touched. Code that goes over it by ``row_blocks`` keeps only one block at a time in memory.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any
from weakref import WeakSet

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loopid.errors import OutputError

# Rows that are in memory at a time.
BLOCK_ROWS = 4096
# Single rows that are fetched at a time.
PICKED_ROWS = 64
# Bytes of an array from which on it goes to a file.
SPOOLED_BYTES = 2**20

_mappings: WeakSet[mmap.mmap] = WeakSet()


def row_blocks(rows: int | slice, size: int | None = None) -> Iterator[slice]:
    """The rows, or so many from 0 on, in blocks; pages of files leave the memory after each."""
    whole = slice(0, rows) if isinstance(rows, int) else rows
    step = BLOCK_ROWS if size is None else size
    for first in range(whole.start, whole.stop, step):
        yield slice(first, min(first + step, whole.stop))
        release_pages()


def release_pages() -> None:
    """Let the pages of all files leave the memory; they come back when they are touched."""
    if hasattr(mmap, "MADV_DONTNEED"):
        for mapping in list(_mappings):
            mapping.madvise(mmap.MADV_DONTNEED)


def empty_columns(count: int, width: int) -> NDArray[np.float64]:
    """A writable array (N, k), stored column after column, in a file if it is large."""
    size = 8 * count * width
    if size <= SPOOLED_BYTES:
        return np.empty((width, count)).T
    with _room(), tempfile.TemporaryFile() as file:
        if hasattr(os, "posix_fallocate"):  # or a full disk would be a fault of the bus later
            os.posix_fallocate(file.fileno(), 0, size)
        else:
            file.truncate(size)
        mapping = mmap.mmap(file.fileno(), size)
    _mappings.add(mapping)
    return np.frombuffer(mapping, np.float64).reshape(width, count).T


def spooled(blocks: Iterable[NDArray[Any]]) -> NDArray[Any]:
    """One read-only array of rows that come block by block, at least one."""
    spool = Spool()
    for block in blocks:
        spool.append(block)
    return spool.array()


def mapped_rows(function: Callable[[slice], NDArray[Any]], count: int) -> NDArray[Any]:
    """What a function makes of each block of rows, spooled."""
    return spooled(function(rows) for rows in row_blocks(count))


def picked(array: NDArray[Any], rows: NDArray[np.int64]) -> NDArray[Any]:
    """Single rows, a few at a time: the system fetches many around each."""
    return np.concatenate([array[rows[few]] for few in row_blocks(len(rows), PICKED_ROWS)])


class Spool:
    """Rows that are appended, and then read as one array."""

    def __init__(self) -> None:
        self._blocks: list[NDArray[Any]] = []
        self._file: Any = None
        self._bytes = self._rows = 0

    def __len__(self) -> int:
        return self._rows

    def __del__(self) -> None:
        if self._file is not None:  # of work that ended early
            self._file.close()

    def append(self, rows: ArrayLike) -> None:
        """Add rows (L, ...); all have the shape and type of the first."""
        block = np.array(rows, order="C")
        self._rows += len(block)
        self._bytes += block.nbytes
        self._blocks.append(block)
        if self._bytes > SPOOLED_BYTES:
            with _room():
                self._file = self._file or tempfile.TemporaryFile()  # noqa: SIM115
                for waiting in self._blocks:
                    self._file.write(waiting.tobytes())
                self._file.flush()
            # One empty block stays, for the shape and type.
            self._blocks = [block[:0].copy()]

    def array(self) -> NDArray[Any]:
        """All rows, read-only."""
        if self._file is None:
            whole = np.concatenate(self._blocks)
            whole.setflags(write=False)
            return whole
        with self._file as file:
            mapping = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        _mappings.add(mapping)
        sample = self._blocks[0]
        return np.frombuffer(mapping, sample.dtype).reshape(self._rows, *sample.shape[1:])


@contextmanager
def _room() -> Iterator[None]:
    """Say where there is none for temporary files."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"cannot write temporary files to {tempfile.tempdir}: {error.strerror}; set TMPDIR to "
            "a folder with more room"
        ) from error


def in_file(array: ArrayLike, dtype: Any = np.float64) -> bool:
    """Whether an array of a type lies in a temporary file."""
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, memoryview):
        base = base.obj
    return isinstance(base, mmap.mmap) and np.asarray(array).dtype == np.dtype(dtype)
