"""Logs in HDF5, read by h5py: a stream a group, of arrays, matrices and tables with fields."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

from loopid.errors import LogError, optional
from loopid.logs.table import ArrayFormat, has_columns


class Hdf5Format(ArrayFormat):
    """A stream a group."""

    endings = (".h5", ".hdf5")
    choice = "group"
    ordered = False  # groups list their arrays by name
    kind = "HDF5 file"

    def _arrays(self) -> Iterator[tuple[str, str, NDArray[Any]]]:
        with optional("h5py", "logs"):
            import h5py
        with h5py.File(self.path, "r") as file:
            chosen, items = (self.chosen or "").strip("/"), dict[str, Any]()
            file.visititems(items.__setitem__)
            groups = [name for name, item in items.items() if isinstance(item, h5py.Group)]
            if chosen:
                LogError.require("group", chosen, groups, f" of {self.path}")
            for name, item in items.items():
                inside = not chosen or name.startswith(f"{chosen}/")
                if not (inside and isinstance(item, h5py.Dataset)):
                    continue
                # Entries that are arrays of any length are packed pictures, which are not read.
                packed = h5py.check_vlen_dtype(item.dtype) not in (None, str, bytes)
                if has_columns(item.shape or ()) and not packed:
                    yield item.parent.name, name.rpartition("/")[-1], item[()]
