"""Logs in HDF5 files: a stream a group, each with arrays of equal length."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loopid.errors import LogError
from loopid.logs.hdf5_columns import columns_of
from loopid.logs.reader import LogReader
from loopid.logs.refusals import optional, refusals
from loopid.logs.table import Table, common_length
from loopid.scratch import row_blocks

if TYPE_CHECKING:
    import h5py

# Bytes of unpacked chunks that are kept for each array: a chunk may hold many blocks of rows.
CACHE_BYTES = 2**24


class Hdf5Reader(LogReader):
    """Arrays (R,) are columns; so are those of a matrix (R, k) or of a table with fields.

    A matrix ``x`` stands for columns ``x_0`` to ``x_k-1``, or for those that its attribute
    ``columns`` names.
    """

    format = "hdf5"
    choice = "group"
    # Groups list their arrays by name.
    ordered = False

    @classmethod
    def accepts(cls, path: Path) -> bool:
        return path.suffix.lower() in (".h5", ".hdf5") and not path.is_dir()

    def columns(self) -> dict[str, tuple[str, ...]]:
        with self._opened() as file:
            found = columns_of(self._path, self._chosen(file))
        return {stream: tuple(columns) for stream, columns in found.items()}

    def read(self, stream: str, names: Sequence[str]) -> Iterator[Table]:
        path = self._path
        with self._opened() as file:
            found = columns_of(path, self._chosen(file))[stream]
            places = {name: found[name] for name in names}
            arrays = {place.array: file[place.array] for place in places.values()}
            for name, place in places.items():
                _refuse_text(path, name, place.kind(arrays[place.array].dtype))
            lengths = {name: len(arrays[place.array]) for name, place in places.items()}
            for rows in row_blocks(common_length(path, lengths)):
                blocks = {array: values[rows] for array, values in arrays.items()}
                columns = {name: place.of(blocks[place.array]) for name, place in places.items()}
                yield Table.of_rows(str(path), columns, rows.start)

    def _chosen(self, file: h5py.File) -> h5py.Group:
        """The group that the mapping names, by default all of the file."""
        import h5py

        name = self._mapping.group
        if name is None:
            return file
        if not isinstance(file.get(name), h5py.Group):
            groups: list[str] = []
            file.visititems(
                lambda at, item: groups.append(at) if isinstance(item, h5py.Group) else None
            )
            valid = f"choose among {', '.join(groups)}" if groups else "it has no groups"
            raise LogError(f"{self._path} has no group {name!r}: {valid}")
        return file[name]

    @contextmanager
    def _opened(self) -> Iterator[h5py.File]:
        with optional("h5py"):
            import h5py
        with (
            refusals(self._path, "HDF5 file"),
            h5py.File(self._path, "r", rdcc_nbytes=CACHE_BYTES) as file,
        ):
            yield file


def _refuse_text(path: Path, name: str, kind: np.dtype[Any]) -> None:
    if kind.kind not in "iuf":
        raise LogError(f"{path}: column {name!r} holds {kind}, not numbers")
