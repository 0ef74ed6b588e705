"""Logs of NumPy: arrays by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from loopid.logs.table import ArrayFormat, Column, array_columns, refusals, stream_name


class NpzFormat(ArrayFormat):
    """Arrays of NumPy."""

    endings = (".npz",)
    kind = ".npz of numbers"

    @cached_property
    def _streams(self) -> dict[str, dict[str, Column]]:
        columns: dict[str, Column] = {}
        with refusals(self.path, self.kind), ZipFile(self.path) as archive:
            for member in archive.namelist():
                array, shape = member.removesuffix(".npy"), _shape(archive, member)
                self.collect(columns, array, array_columns(array, shape))
        return {stream_name(self.path): columns}

    def _read(self, arrays: Iterable[str]) -> Mapping[str, NDArray[Any]]:
        with np.load(self.path, allow_pickle=False) as content:
            return {array: content[array] for array in arrays}


def _shape(archive: ZipFile, name: str) -> tuple[int, ...]:
    """Shape of an array, which is not read."""
    with archive.open(name) as file:
        old = np.lib.format.read_magic(file) == (1, 0)
        read = np.lib.format.read_array_header_1_0 if old else np.lib.format.read_array_header_2_0
        return read(file)[0]
