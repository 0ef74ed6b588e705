"""A robot for its controller: C source of motor signals, from templates and CasADi's functions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from importlib import import_module
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, checked, shaped
from loopid.errors import OptionError, optional
from loopid.files import write_files
from loopid.identification.force_models import ForceModel
from loopid.kinematics.assembly import CONTRACTION, LONGEST_STEP, USUAL
from loopid.kinematics.measured import measured_coordinates
from loopid.kinematics.projection import NEAR_SINGULARITY
from loopid.records import record
from loopid.robot.robot import Robot

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")  # as CasADi has it
LONGEST_NAME = 60  # of files and functions that are named after the robot
LONGEST_TEXT = 4000  # bytes: C99 promises strings of 4095
CLOSED = 1e-9  # m
SHORTEST_PART = 2.0**-16  # of the way from the reference, before it is given up
ONE_SIGNATURE = """/* CasADi's functions share one signature, of which not all is used. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
"""


@record(checked=True)
class CSource:
    """C source of a robot, for its controller, and the same for CasADi."""

    name: str  # what all its functions and macros begin with
    header: str = field(repr=False)  # contents of ``<name>.h`` and ``<name>.c``
    source: str = field(repr=False)
    # For ``casadi.Function.deserialize``: the closures' residual, q̇, forces, M and the forces C u̇ +
    # g + friction, of closed configurations q, of u̇ and ü of the motors and of base parameters
    casadi: str = field(repr=False)

    def save(self, folder: str | Path) -> list[Path]:
        """Write the three files, whole or not at all."""
        contents = {"h": self.header, "c": self.source, "casadi": self.casadi}
        named = {f"{self.name}.{ending}": content for ending, content in contents.items()}
        return write_files(folder, named)


@checked
def c_source(
    model: ForceModel, *, name: str | None = None, values: FloatArray | None = None
) -> CSource:
    """Generate C source of a force model, for a controller that knows its motors only.

    From the motors' positions, velocities and accelerations come all joints (``<name>_assemble``)
    and forces (``<name>_gravity``, ``<name>_forces``). So do K (dof, n) as ``ForceModel.regressor``
    has it (``<name>_regressor``), and external forces (``<name>_observe``). The header says how.
    Nothing is allocated, and nothing kept but a ``struct <name>_state``.

    Parameters
    ----------
    model : ForceModel
    name : str, optional
        A C identifier; by default made of the robot's name.
    values : FloatArray, optional
        Of the base parameters (n,), to be put into the source.

    Returns
    -------
    CSource
        The texts of the files; ``save`` writes them.

    Raises
    ------
    MissingExtraError
        When CasADi is not installed.
    OptionError
        When the name is no identifier, or a joint has no symbolic form.
    DataError
        When there are not n finite values.

    Examples
    --------
    >>> import loopid, tempfile
    >>> model = loopid.force_model(loopid.load("five_bar"), joint_terms=None)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in loopid.export.c_source(model).save(folder)]
    ['five_bar.h', 'five_bar.c', 'five_bar.casadi']
    """
    with optional("casadi", "codegen"):
        import_module("casadi")
    from loopid.export.symbolic import SymbolicRobot, c_of  # here, as it needs CasADi

    chosen = _identifier(model.robot.name) if name is None else name
    if not IDENTIFIER.fullmatch(chosen):
        raise OptionError(
            "the name of C functions must begin with a letter, then letters and digits with single "
            f"_ between them, not {chosen!r}",
            given=chosen,
        )
    given = _value_fields(model, chosen, values)
    robot = SymbolicRobot(model)
    functions = robot.functions(f"{chosen}_casadi")
    smooth = map(robot.smoothing, model.robot.velocity_indices(model.robot.independent).tolist())
    fields = _fields(model, chosen, functions, [*smooth]) | given
    parts = c_of(functions, f"{chosen}_casadi"), _filled("robot.c", fields)
    source = "\n".join([f'#include <string.h>\n#include "{chosen}.h"\n', ONE_SIGNATURE, *parts])
    whole = robot.whole(functions, chosen).serialize()
    return CSource(chosen, _filled("robot.h", fields), source, whole)


def _identifier(name: str) -> str:
    """A C identifier that is like the name of a robot."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name)[:LONGEST_NAME].strip("_")
    return plain if IDENTIFIER.fullmatch(plain) else f"robot_{plain}".strip("_")


def _filled(template: str, fields: Mapping[str, str]) -> str:
    """A template with what is between @ signs filled in."""
    text = files("loopid.export").joinpath("templates", template).read_text(encoding="utf-8")
    return re.sub(r"@([A-Z_]+)@", lambda match: fields[match[1]], text)


def _fields(
    model: ForceModel, name: str, functions: Mapping[str, Any], smooth: Sequence[float]
) -> dict[str, str]:
    """Names, numbers and tolerances that the templates are filled with."""
    robot, linearise = model.robot, functions["linearise"]
    joints = [(joint, robot.joint(joint).nq) for joint in robot.joints]
    # A joint's name where it has one position, else numbered from 0.
    positions = [j if nq == 1 else f"{j}[{k}]" for j, nq in joints for k in range(nq)]
    reference, motors = robot.reference, robot.independent
    units = [robot.units(motor)[0] for motor in motors]
    return {
        "NAME": name,
        "GUARD": name.upper(),
        "ROBOT": _string(robot.name),
        "MODEL": model.model,
        "VERSION": version("loopid"),
        "MOTORS": _motor_lines(robot, units),
        "NQ": str(robot.model.nq),
        "DOF": str(len(motors)),
        "PARAMETERS": str(len(model.parameters)),
        "SLIPS": str(max(1, len(model.slip_columns))),  # C has no empty arrays
        "COUPLED": str(max(1, linearise.numel_out(0))),  # C has no empty arrays
        "FACTORS": str(max(1, linearise.numel_out(1))),
        "SMOOTH": ", ".join(
            dict.fromkeys(f"{rate:.4g} {unit}/s" for rate, unit in zip(smooth, units, strict=True))
        ),
        "REFERENCE_Q": _numbers(reference),
        "REFERENCE_U": _numbers(motor_positions(robot, reference[None])[0]),
        "LONGEST_STEP": repr(LONGEST_STEP),
        "CONTRACTION": repr(CONTRACTION),
        "SHORT": repr(USUAL.short),
        "CLOSED": repr(_closed(robot)),
        "NEAR_SINGULARITY": repr(NEAR_SINGULARITY),
        "SHORTEST_PART": repr(SHORTEST_PART),
        "MOTOR_NAMES": _strings(motors),
        "POSITION_NAMES": _strings(positions),
        "PARAMETER_NAMES": _strings(model.parameters.names),
        "PARAMETER_UNITS": _strings(parameter.unit for parameter in model.parameters),
        "PARAMETER_EXPRESSIONS": _strings(model.base.expressions),
    }


def _closed(robot: Robot) -> float:
    """What is left of the closures' residual at most, in m."""
    return float(max(CLOSED, 2 * robot.closure_residual * robot.rows**0.5))


def _motor_lines(robot: Robot, units: Sequence[str]) -> str:
    """Motors for a comment, which no name may end."""
    plain = (re.sub(r"[^a-zA-Z0-9_.+-]", "_", name)[:LONGEST_NAME] for name in robot.independent)
    lines = zip(range(len(units)), plain, units, strict=True)
    return "\n".join(f"     {k}: {name}, {unit}" for k, name, unit in lines)


def motor_positions(robot: Robot, q: FloatArray) -> FloatArray:
    """Positions (N, dof) of the independent coordinates; 0 of those that are a part of a joint."""
    u = np.zeros((len(q), len(robot.independent)))
    measured = [robot.independent.index(name) for name in robot.measured]
    u[:, measured] = measured_coordinates(robot).read(q)
    return u


def _value_fields(model: ForceModel, name: str, values: FloatArray | None) -> dict[str, str]:
    """Values of the base parameters (n,) as a constant, where they are given."""
    if values is None:
        return {"VALUES": "", "VALUES_DECLARATION": ""}
    phi = shaped(values, "base parameters", len(model.parameters))
    declared = f"const double {name}_values[{name.upper()}_PARAMETERS]"
    listed = ",\n    ".join(map(repr, phi.tolist()))
    return {
        "VALUES": f"{declared} = {{\n    {listed}}};\n",
        "VALUES_DECLARATION": f"/* Identified values of phi. */\nextern {declared};\n",
    }


def _numbers(values: FloatArray) -> str:
    return ", ".join(map(repr, values.tolist()))


def _strings(texts: Iterable[str]) -> str:
    return ",".join(f"\n    {_string(text)}" for text in texts)


def _string(text: str) -> str:
    """A C string; every character but plain ones by its octal codes.

    Names come from files of any origin. A backslash at the end of a line or a trigraph would let
    them out.
    """
    codes = text.encode("utf-8", "backslashreplace")
    if len(codes) > LONGEST_TEXT:
        codes = codes[: LONGEST_TEXT - 3] + b"..."
    plain = (chr(c) if 32 <= c < 127 and chr(c) not in '"\\?' else f"\\{c:03o}" for c in codes)
    return f'"{"".join(plain)}"'
