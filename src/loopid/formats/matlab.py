"""Logs of MATLAB, read by SciPy: arrays by name, and fields of structures as ``name.field``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loopid.logs.table import WIDEST, ArrayFormat, Column, refusals, stream_name


class MatFormat(ArrayFormat):
    """Arrays of N numbers are columns, a matrix (N, k) or (k, N) is those ``x_0`` to ``x_k-1``."""

    endings = (".mat",)
    kind = ".mat of numbers"

    @cached_property
    def _streams(self) -> dict[str, dict[str, Column]]:
        columns: dict[str, Column] = {}
        for name, array in self._arrays.items():
            count = array.shape[1]
            places = {name: 0} if count == 1 else {f"{name}_{k}": k for k in range(count)}
            self.collect(columns, name, places)
        return {stream_name(self.path): columns}

    def _read(self, arrays: Iterable[str]) -> Mapping[str, NDArray[Any]]:
        return {name: self._arrays[name] for name in arrays}

    @cached_property
    def _arrays(self) -> dict[str, NDArray[Any]]:
        from scipy.io import loadmat

        with refusals(self.path, self.kind):
            try:
                content = loadmat(self.path, simplify_cells=True)
            except NotImplementedError as error:
                said = "was saved with -v7.3: save it with '-v7' in MATLAB"
                raise self.refused(said) from error
        named = {name: x for name, x in content.items() if not name.startswith("__")}
        return dict(_numbers(named))


def _numbers(content: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Tables (N, k) of numbers by name, in structures too; samples are along the longer axis."""
    for key, value in content.items():
        if isinstance(value, dict):
            yield from _numbers(value, f"{before}{key}.")
            continue
        array = np.atleast_1d(value)
        if array.dtype.kind in "biuf" and array.ndim <= 2 and array.size > 1:
            table = array.reshape(len(array), -1) if array.ndim == 1 else array
            table = table.T if table.shape[0] < table.shape[1] else table
            if table.shape[1] <= WIDEST:
                yield before + key, table
