"""Which columns the arrays of an HDF5 file stand for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loopid.errors import LogError

if TYPE_CHECKING:
    import h5py

# Wider matrices are pictures or the like, not columns.
WIDEST = 1000


class Column(NamedTuple):
    """Where a column is: all of an array, a column of a matrix, or a field of a table."""

    array: str
    place: int | str | None

    def kind(self, dtype: np.dtype[Any]) -> np.dtype[Any]:
        """What it holds, of what its array holds."""
        return dtype[self.place] if isinstance(self.place, str) else dtype

    def of(self, rows: NDArray[Any]) -> NDArray[Any]:
        """The column (R,) in some rows of its array."""
        if self.place is None:
            return rows
        return rows[self.place] if isinstance(self.place, str) else rows[:, self.place]


def columns_of(path: Path, group: h5py.Group) -> dict[str, dict[str, Column]]:
    """Columns by name, for each group in a group that holds any.

    Raises
    ------
    LogError
        When there are none, or two in one group are called alike.
    """
    import h5py

    streams: dict[str, dict[str, Column]] = {}

    def visit(_: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.shape:
            columns = streams.setdefault(item.parent.name, {})
            for name, column in _columns(path, item).items():
                if name in columns:
                    raise LogError(
                        f"{path}: group {item.parent.name} has column {name!r} in "
                        f"{columns[name].array} and {item.name}"
                    )
                columns[name] = column

    group.visititems(visit)
    streams = {name: columns for name, columns in streams.items() if columns}
    if not streams:
        raise LogError(f"{path} holds no arrays with one or two axes in {group.name}")
    return streams


def _columns(path: Path, array: h5py.Dataset) -> dict[str, Column]:
    name = array.name.rsplit("/", 1)[-1]
    if array.ndim == 1:
        if array.dtype.names is None:
            return {name: Column(array.name, None)}
        fields = [field for field in array.dtype.names if not array.dtype[field].shape]
        return {field: Column(array.name, field) for field in fields}
    if array.ndim != 2 or array.shape[1] > WIDEST:
        return {}
    names = _given_names(array) or [f"{name}_{k}" for k in range(array.shape[1])]
    if len(names) != array.shape[1] or len(set(names)) < len(names):
        raise LogError(
            f"{path}: the attribute 'columns' of {array.name} must hold {array.shape[1]} "
            f"different names, not {', '.join(names)}"
        )
    return {name: Column(array.name, k) for k, name in enumerate(names)}


def _given_names(array: h5py.Dataset) -> list[str]:
    """What the attribute ``columns`` names, as texts or as one text with commas."""
    given = array.attrs.get("columns")
    if given is None:
        return []
    cells = np.atleast_1d(np.asarray(given, dtype=object)).ravel().tolist()
    texts = [cell.decode() if isinstance(cell, bytes) else str(cell) for cell in cells]
    return [name.strip() for name in texts[0].split(",")] if len(texts) == 1 else texts
