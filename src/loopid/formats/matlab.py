"""Logs of MATLAB, read by SciPy: arrays by name, and fields of structures as ``name.field``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loopid.logs.table import ArrayFormat, has_columns, stream_name


class MatFormat(ArrayFormat):
    """Arrays and matrices of numbers, also in structures."""

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
