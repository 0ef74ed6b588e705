"""Generated C as a shared library, called with arrays: to measure it, and for the tests."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from loopid.export import RegressorCode
from loopid.identification import ForceModel

NUMBERS = ctypes.POINTER(ctypes.c_double)


class CompiledRegressor:
    """The functions of the C code of a force model, compiled in a folder."""

    def __init__(
        self, model: ForceModel, code: RegressorCode, folder: Path, flags: Sequence[str] = ("-O2",)
    ) -> None:
        self.model, self.name = model, code.name
        *_, source = code.save(folder)
        library = source.with_suffix(".so").absolute()
        command = ["cc", *flags, "-shared", "-fPIC", str(source), "-lm", "-o", str(library)]
        subprocess.run(command, check=True)
        self.library = ctypes.CDLL(str(library))

    def __call__(
        self, configurations: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Regressors (N, dof, n) and statuses (N,) of states (N, nq), (N, nv), (N, nv)."""
        dof, count = len(self.model.mechanism.independent), len(configurations)
        K = np.empty((count, dof, len(self.model.parameters)))
        states = map(np.ascontiguousarray, (configurations, velocities, accelerations))
        call = self.function("regressor", ctypes.c_int, 4)
        rows = zip(*states, K, strict=True)
        status = [call(*(row.ctypes.data_as(NUMBERS) for row in state)) for state in rows]
        return K, np.array(status)

    def function(self, ending: str, result: Any, arguments: int) -> Any:
        """A C function of arrays of numbers."""
        call = self.library[f"{self.name}_{ending}"]
        call.restype, call.argtypes = result, [NUMBERS] * arguments
        return call
