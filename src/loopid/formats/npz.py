"""Logs of NumPy: arrays by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from zipfile import ZipFile

from numpy.lib import format as npy
from numpy.typing import NDArray

from loopid.errors import DataWarning, warn
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
