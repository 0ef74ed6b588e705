"""Arrays by name: NPZ of NumPy, HDF5 read by h5py, MAT of MATLAB read by SciPy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any
from zipfile import ZipFile

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from loopid.errors import DataWarning, LogError, optional, warn
from loopid.logs.table import ArrayFormat, has_columns, stream_name


class NpzFormat(ArrayFormat):
    """Arrays of NumPy."""

    endings = (".npz",)
    kind = ".npz of numbers"

    def _arrays(self) -> Iterator[tuple[str, str, NDArray[Any]]]:
        with ZipFile(self.path) as archive:
            for member in archive.namelist():
                with archive.open(member) as file:  # first what it is: pictures are not read
                    old = npy.read_magic(file) == (1, 0)
                    read = npy.read_array_header_1_0 if old else npy.read_array_header_2_0
                    shape, _, kind = read(file)
                if has_columns(shape) and kind.hasobject:
                    said = "has objects, which are not read: save it as numbers"
                    warn(f"{self.path}: array {member.removesuffix('.npy')} {said}", DataWarning)
                elif has_columns(shape):
                    with archive.open(member) as file:
                        values = npy.read_array(file)
                    yield stream_name(self.path), member.removesuffix(".npy"), values


class Hdf5Format(ArrayFormat):
    """A stream a group, of arrays, matrices and tables with fields."""

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


class MatFormat(ArrayFormat):
    """Arrays and matrices of numbers; fields of structures are ``name.field``."""

    endings = (".mat",)
    kind = ".mat of numbers"

    def _arrays(self) -> Iterator[tuple[str, str, NDArray[Any]]]:
        from scipy.io import loadmat

        try:
            content = loadmat(self.path, simplify_cells=True)
        except NotImplementedError as error:
            said = "was saved with -v7.3: save it with '-v7' in MATLAB"
            raise self.refused(said) from error
        named = {name: x for name, x in content.items() if not name.startswith("__")}
        for name, array in _numbers(named):
            yield stream_name(self.path), name, array


def _numbers(content: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Arrays of numbers by name, in structures too."""
    for key, value in content.items():
        array = np.asarray(value)
        if isinstance(value, dict):
            yield from _numbers(value, f"{before}{key}.")
        elif array.dtype.kind in "biuf" and array.size > 1 and has_columns(array.shape):
            yield before + key, array
