"""Generated C, compiled and called from Python: to verify it, and to measure it."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from loopid.arguments import checked, checked_fields
from loopid.arrays import FloatArray, IntArray, samples
from loopid.errors import OptionError, OutputError
from loopid.experiment import ForceModel
from loopid.export.codegen.source import RegressorCode

COMPILERS = ("cc", "gcc", "clang")
DEFAULT_FLAGS = ("-O2",)
NUMBERS = ctypes.POINTER(ctypes.c_double)


@checked_fields
@dataclass(frozen=True)
class CompiledRegressor:
    """The functions of generated C, on arrays.

    Attributes
    ----------
    model : ForceModel
        That the code was generated from.
    name : str
    library : Path
    """

    model: ForceModel
    name: str
    library: Path

    def __call__(
        self, configurations: FloatArray, velocities: FloatArray, accelerations: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Regressors (N, dof, n) and statuses (N,), 0 where all is well.

        Parameters
        ----------
        configurations, velocities, accelerations : FloatArray
            (N, nq), (N, nv), (N, nv), of all joints.
        """
        model = self.model.mechanism.model
        q = samples(configurations, model.nq, "configurations")
        v = samples(velocities, model.nv, "velocities", len(q))
        a = samples(accelerations, model.nv, "accelerations", len(q))
        shape = len(q), len(self.model.mechanism.independent), len(self.model.parameters)
        K, status = np.empty(shape), np.empty(len(q), dtype=np.int64)
        call = self.function("regressor", ctypes.c_int, 4)
        states = (np.ascontiguousarray(part) for part in (q, v, a))
        for k, state in enumerate(zip(*states, K, strict=True)):
            status[k] = call(*(row.ctypes.data_as(NUMBERS) for row in state))
        return K, status

    def closure_residuals(self, configurations: FloatArray) -> FloatArray:
        """Largest closure residuals (N,) in m at configurations (N, nq)."""
        q = samples(configurations, self.model.mechanism.model.nq, "configurations")
        call = self.function("closure_residual", ctypes.c_double, 1)
        rows = np.ascontiguousarray(q)
        return np.array([call(row.ctypes.data_as(NUMBERS)) for row in rows])

    def function(self, ending: str, result: Any, arguments: int) -> Any:
        """A C function of arrays of numbers."""
        call = getattr(ctypes.CDLL(str(self.library)), f"{self.name}_{ending}")
        call.restype, call.argtypes = result, [NUMBERS] * arguments
        return call


@checked
def compile_regressor(
    model: ForceModel,
    code: RegressorCode,
    folder: str | Path,
    flags: Sequence[str] = DEFAULT_FLAGS,
) -> CompiledRegressor:
    """Write generated C to a folder and make a shared library of it.

    Raises
    ------
    OptionError
        When there is no C compiler.
    OutputError
        When the compiler fails.
    """
    compiler = next((found for found in map(shutil.which, COMPILERS) if found), None)
    if compiler is None:
        raise OptionError(f"there is no C compiler: install one of {', '.join(COMPILERS)}")
    code.save(folder)
    library = Path(folder, f"{code.name}.so").absolute()
    source = str(Path(folder, f"{code.name}.c"))
    command = [compiler, *flags, "-shared", "-fPIC", source, "-lm", "-o", str(library)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise OutputError(f"{compiler} refuses {source}: {done.stderr.strip()}")
    return CompiledRegressor(model, code.name, library)
