"""Logs of NumPy: arrays by name."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from io import BytesIO
from typing import Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
from numpy.typing import NDArray

from loopid.errors import LogError
from loopid.logs.table import ArrayFormat, Column, array_columns, refusals, stream_name

HEADER_BYTES = 20_000  # of an array in an .npz: NumPy reads no longer ones


class NpzFormat(ArrayFormat):
    """Arrays of NumPy."""

    endings = (".npz",)
    kind = ".npz of numbers"

    @cached_property
    def _streams(self) -> dict[str, dict[str, Column]]:
        columns: dict[str, Column] = {}
        with refusals(self.path, self.kind), ZipFile(self.path) as archive:
            for member in archive.namelist():
                array, (shape, _) = member.removesuffix(".npy"), _npy_header(archive, member)
                self.collect(columns, array, array_columns(array, shape))
        if not columns:
            raise LogError(f"{self.path} holds no arrays with one or two axes", file=self.path)
        return {stream_name(self.path): columns}

    def _read(self, arrays: Iterable[str]) -> Mapping[str, NDArray[Any]]:
        ceiling = self.ceiling()
        with ZipFile(self.path) as archive, np.load(self.path, allow_pickle=False) as content:
            for member in (n for n in archive.namelist() if n.removesuffix(".npy") in arrays):
                shape, dtype = _npy_header(archive, member)
                ceiling.count(math.prod(shape) * dtype.itemsize)
            return {array: content[array] for array in arrays}


def _npy_header(archive: ZipFile, name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of an array, which is not read."""
    if archive.getinfo(name).compress_type not in (ZIP_STORED, ZIP_DEFLATED):
        raise ValueError(f"{name} is packed in another way than NumPy's")  # nor as zipfile limits
    with archive.open(name) as member:
        file = BytesIO(member.read(HEADER_BYTES))
        old = np.lib.format.read_magic(file) == (1, 0)
        read = np.lib.format.read_array_header_1_0 if old else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
        return shape, dtype
