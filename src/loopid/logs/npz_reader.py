"""Logs in NumPy's .npz: one array a column, or a matrix for several."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loopid.errors import LogError, MissingFileError
from loopid.logs.reader import LogReader
from loopid.logs.table import Table


class NpzReader(LogReader):
    """Arrays (R,) are columns; a matrix ``x`` (R, k) stands for columns ``x_0`` to ``x_k-1``."""

    format = "npz"

    def accepts(self, path: Path) -> bool:
        return path.suffix.lower() == ".npz" and not path.is_dir()

    def columns(self, path: Path) -> dict[str, tuple[str, ...]]:
        return {path.stem: tuple(_columns(path))}

    def read(self, path: Path, stream: str, names: Sequence[str]) -> Table:
        found = _columns(path)
        columns = {name: found[name] for name in names}
        lengths = {name: len(column) for name, column in columns.items()}
        if len(set(lengths.values())) > 1:
            short, long = (pick(lengths, key=lambda name: lengths[name]) for pick in (min, max))
            raise LogError(
                f"{path}: {short!r} has {lengths[short]} rows, but {long!r} has {lengths[long]}"
            )
        rows = np.arange(1, next(iter(lengths.values())) + 1)
        return Table(str(path), columns, rows, np.empty(0, dtype=np.int64))


def _columns(path: Path) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {}
    for name, array in _arrays(path).items():
        if array.ndim == 1:
            columns[name] = array
        elif array.ndim == 2:
            columns.update((f"{name}_{k}", column) for k, column in enumerate(array.T))
    if not columns:
        raise LogError(f"{path} holds no arrays with one or two axes")
    return columns


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with np.load(io.BytesIO(path.read_bytes())) as content:
            return dict(content)
    except FileNotFoundError as error:
        raise MissingFileError(f"there is no log {path}") from error
    except (OSError, ValueError, EOFError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"{path} is no .npz of numbers: {error}") from error
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise LogError(f"{path} is damaged: {error}") from error
