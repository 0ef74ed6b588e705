"""Generated C as a shared library, called with arrays: to measure it, and for the tests."""

from __future__ import annotations

import ctypes
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from loopid.export.c_code import CSource, motor_positions
from loopid.identification import ForceModel
from loopid.kinematics import ClosedMotion

NUMBERS = ctypes.POINTER(ctypes.c_double)


class CompiledRobot:
    """The functions of the C code of a force model, compiled in a folder, with a state."""

    def __init__(
        self, model: ForceModel, code: CSource, folder: Path, flags: Sequence[str] = ("-O2",)
    ) -> None:
        self.model, self.name = model, code.name
        _, source, _ = code.save(folder)
        library = source.with_suffix(".so").absolute()
        command = ["cc", *flags, "-shared", "-fPIC", str(source), "-lm", "-o", str(library)]
        subprocess.run(command, check=True)
        self.library = ctypes.CDLL(str(library))
        self.state = _state_type(code)()

    def call(self, function: str, *arguments: Any) -> int:
        """The status of a C function of the state, arrays and numbers."""
        given = [
            each.ctypes.data_as(NUMBERS) if isinstance(each, np.ndarray) else ctypes.c_double(each)
            for each in arguments
        ]
        status: int = self.library[f"{self.name}_{function}"](ctypes.byref(self.state), *given)
        return status

    def place(self, q: np.ndarray, u: np.ndarray) -> int:
        """Put the state to a closed configuration (nq,) with motors at u (dof,)."""
        ctypes.memset(ctypes.byref(self.state), 0, ctypes.sizeof(self.state))
        self.state.q[:], self.state.u[:] = q, u
        return self.call("assemble", u)

    def moved(self, q: np.ndarray, u: np.ndarray, to: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Configurations (N, nq) after an assembly each, from (N, nq), and statuses (N,)."""
        reached, status = np.zeros(q.shape), np.zeros(len(q))
        for k in range(len(q)):
            self.place(q[k], u[k])
            status[k] = self.call("assemble", to[k])
            reached[k] = self.state.q
        return reached, status

    def regressors(self, motion: ClosedMotion) -> tuple[np.ndarray, np.ndarray]:
        """Regressors (N, dof, n) and statuses (N,) along a motion, each state on its own."""
        mechanism = self.model.robot
        chosen = mechanism.velocity_indices(mechanism.independent)
        motors = motor_positions(mechanism, motion.configurations)
        rates, second = motion.velocities[:, chosen], motion.accelerations[:, chosen]
        K, status = list[np.ndarray](), list[int]()
        for q, u, *given in zip(motion.configurations, motors, rates, second, strict=True):
            status.append(self.place(q, u))
            K.append(self.regressor(*given))
        return np.array(K), np.array(status)

    def regressor(self, du: np.ndarray, ddu: np.ndarray) -> np.ndarray:
        """K (dof, n) at the state, NaN where it is told to be not finite."""
        K = np.zeros((len(du), len(self.model.parameters)))
        status = self.call("regressor", *map(np.ascontiguousarray, (du, ddu)), K)
        assert status == (0 if np.isfinite(K).all() else 3)
        return K


def _state_type(code: CSource) -> type[ctypes.Structure]:
    """The struct of the header, whose sizes are numbers or macros of it."""
    macros = dict(re.findall(r"#define (\w+) (\d+)", code.header))
    body = re.search(r"struct \w+_state \{(.*?)\};", code.header, re.DOTALL)
    assert body is not None
    fields: list[tuple[str, Any]] = []
    declared = re.sub(r"/\*.*?\*/", "", body[1], flags=re.DOTALL)
    for kind, names in re.findall(r"(double|int) ([^;]+);", declared):
        basic: Any = {"double": ctypes.c_double, "int": ctypes.c_int}[kind]
        for name, size in re.findall(r"(\w+)(?:\[([^\]]+)\])?,?", names):
            count = (
                np.prod([int(macros.get(part, part)) for part in size.split(" * ")]) if size else 0
            )
            fields.append((name, basic * int(count) if count else basic))
    return type("State", (ctypes.Structure,), {"_fields_": fields})
