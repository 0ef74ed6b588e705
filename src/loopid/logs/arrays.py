"""Logs of arrays: one (R,) is a column; a matrix ``x`` (R, k) stands for ``x_0`` to ``x_k-1``."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, NamedTuple
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from loopid.errors import LogError
from loopid.files import require_plausible
from loopid.logs.formats import LogFormat, Table, array_table, refusals, stream_name

WIDEST = 1000  # columns of a matrix: wider ones are pictures or the like


class Column(NamedTuple):
    """A column in a file of arrays: all of one, a column of a matrix, or a field of a table."""

    array: str
    place: Any = ...  # index behind that of the rows, or name of the field

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """The column (R,) of the array's values."""
        return values[self.place] if isinstance(self.place, str) else values[:, self.place]


class ArrayFormat(LogFormat):
    """Streams of arrays by name."""

    kind: ClassVar[str]  # for messages

    @property
    @abstractmethod
    def _streams(self) -> dict[str, dict[str, Column]]:
        """Columns by name, for each stream that has any."""

    @abstractmethod
    def _read(self, arrays: Iterable[str]) -> Mapping[str, NDArray[Any]]:
        """Arrays (R,) or (R, k) by name."""

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {stream: tuple(columns) for stream, columns in self._streams.items()}

    def tables(self, stream: str, names: Sequence[str]) -> Sequence[Table]:
        places = {name: self._streams[stream][name] for name in names}
        with refusals(self.path, self.kind):
            arrays = self._read(dict.fromkeys(place.array for place in places.values()))
            columns = {name: place.of(arrays[place.array]) for name, place in places.items()}
            return [array_table(self.path, columns)]

    def collect(self, columns: dict[str, Column], array: str, places: Mapping[str, Any]) -> None:
        """Add columns of an array at their places; none may be there already."""
        for name, place in places.items():
            if name in columns:
                raise LogError(
                    f"{self.path} has column {name!r} in {columns[name].array} and {array}",
                    file=self.path,
                    column=name,
                )
            columns[name] = Column(array, place)


def columns_of(name: str, shape: tuple[int, ...]) -> dict[str, Any]:
    """Names and places of the columns of an array; none of one with other than one or two axes."""
    if len(shape) == 1:
        return {name: ...}
    wide = len(shape) != 2 or shape[1] > WIDEST
    return {} if wide else {f"{name}_{k}": k for k in range(shape[1])}


class NpzFormat(ArrayFormat):
    """Arrays of NumPy in a ZIP file."""

    endings = (".npz",)
    kind = ".npz of numbers"

    @cached_property
    def _streams(self) -> dict[str, dict[str, Column]]:
        columns: dict[str, Column] = {}
        with refusals(self.path, self.kind), ZipFile(self.path) as archive:
            for member in archive.namelist():
                array, (shape, _) = member.removesuffix(".npy"), _npy_header(archive, member)
                self.collect(columns, array, columns_of(array, shape))
        if not columns:
            raise LogError(f"{self.path} holds no arrays with one or two axes", file=self.path)
        return {stream_name(self.path): columns}

    def _read(self, arrays: Iterable[str]) -> Mapping[str, NDArray[Any]]:
        with ZipFile(self.path) as archive, np.load(self.path, allow_pickle=False) as content:
            for member in (n for n in archive.namelist() if n.removesuffix(".npy") in arrays):
                shape, dtype = _npy_header(archive, member)
                stored = archive.getinfo(member).compress_size
                require_plausible(self.path, math.prod(shape) * dtype.itemsize, stored)
            return {array: content[array] for array in arrays}


def _npy_header(archive: ZipFile, name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of an array, which is not read."""
    with archive.open(name) as file:
        old = np.lib.format.read_magic(file) == (1, 0)
        read = np.lib.format.read_array_header_1_0 if old else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
        return shape, dtype
