"""Logs in HDF5, read by h5py: a stream a group, of arrays, matrices and tables with fields."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from loopid.errors import optional
from loopid.logs.table import MOST_LISTED, ArrayFormat, Column, array_columns, refusals

if TYPE_CHECKING:
    import h5py


class Hdf5Format(ArrayFormat):
    """A stream a group."""

    endings = (".h5", ".hdf5")
    choice = "group"
    ordered = False  # groups list their arrays by name
    kind = "HDF5 file"

    @cached_property
    def _streams(self) -> dict[str, dict[str, Column]]:
        streams: dict[str, dict[str, Column]] = {}
        with self._file() as file:
            import h5py

            def collect(_: str, item: Any) -> None:
                if isinstance(item, h5py.Dataset) and item.shape:
                    columns = streams.setdefault(item.parent.name, {})
                    own = item.name.rsplit("/", 1)[-1]
                    places = array_columns(own, item.shape)
                    if item.dtype.names and item.ndim == 1:  # fields that are single numbers
                        places = {f: f for f in item.dtype.names if not item.dtype[f].shape}
                    self.collect(columns, item.name, places)

            self._chosen(file).visititems(collect)
        return streams

    def _chosen(self, file: h5py.File) -> h5py.Group:
        """The group that is required, or the whole file."""
        import h5py

        if self.chosen is None:
            return file
        groups: list[str] = []
        file.visititems(
            lambda name, item: groups.append(name) if isinstance(item, h5py.Group) else None
        )
        if self.chosen.strip("/") not in groups:
            listed = ", ".join(groups[:MOST_LISTED])
            there = f"choose among {listed}" if groups else "it has no groups"
            said = f"has no group {self.chosen!r}: {there}"
            raise self.refused(said, given=self.chosen, valid=groups)
        return file[self.chosen]

    def _read(self, arrays: Iterable[str]) -> Mapping[str, NDArray[Any]]:
        with self._file() as file:
            return {name: file[name][()] for name in arrays}

    @contextmanager
    def _file(self) -> Iterator[h5py.File]:
        with optional("h5py", "logs"):
            import h5py
        with refusals(self.path, self.kind), h5py.File(self.path, "r") as file:
            yield file
