"""Arrays of an .npz, read some rows at a time."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from loopid.scratch import row_blocks

ENDING = ".npy"


@dataclass(frozen=True)
class Member:
    """An array in an archive.

    Attributes
    ----------
    name : str
        Of the array.
    file : str
        Its name in the archive.
    shape : tuple of int
    by_columns : bool
        Whether it is stored column by column.
    dtype : np.dtype
    start : int
        Bytes of the file before the first number.
    """

    name: str
    file: str
    shape: tuple[int, ...]
    by_columns: bool
    dtype: np.dtype[Any]
    start: int

    @property
    def rows(self) -> int:
        """Its length."""
        return self.shape[0]


def read_members(archive: zipfile.ZipFile) -> Iterator[Member]:
    """What the arrays of an archive are.

    Raises
    ------
    ValueError
        When one holds no plain numbers or texts.
    """
    for file in archive.namelist():
        with archive.open(file) as content:
            version = npy.read_magic(content)
            read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, by_columns, dtype = read(content)
            if dtype.hasobject:
                raise ValueError(f"{file} holds Python objects")
            yield Member(file.removesuffix(ENDING), file, shape, by_columns, dtype, content.tell())


def column_blocks(archive: zipfile.ZipFile, member: Member, column: int) -> Iterator[NDArray[Any]]:
    """One column of an array (R,) or (R, k), block by block."""
    width = int(np.prod(member.shape[1:]))
    stride, at = (1, column * member.rows) if member.by_columns else (width, 0)
    place = 0 if member.by_columns else column
    with archive.open(member.file) as content:
        _skip(content, member.start + at * member.dtype.itemsize)
        for rows in row_blocks(member.rows):
            count = (rows.stop - rows.start) * stride
            numbers = _numbers(content, member.dtype, count)
            yield numbers.reshape(-1, stride)[:, place]


def _skip(content: IO[bytes], count: int) -> None:
    # Packed content cannot be jumped over, only unpacked.
    content.seek(count)


def _numbers(content: IO[bytes], dtype: np.dtype[Any], count: int) -> NDArray[Any]:
    data = content.read(count * dtype.itemsize)
    if len(data) < count * dtype.itemsize:
        raise ValueError("an array is shorter than its header says")
    return np.frombuffer(data, dtype)
