"""The regressor as a C file and its header, from templates and CasADi's functions."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import field
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from loopid.arguments import FloatArray, checked, finite
from loopid.errors import DataError, MissingExtraError, OptionError
from loopid.files import write_files
from loopid.identification.force_model import ForceModel
from loopid.kinematics.projection import partition
from loopid.records import record

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")  # as CasADi has it
# Of the pivots: below the first there is no regressor, below the second it is ill-determined.
SINGULAR, NEAR_SINGULARITY = 1e-10, 1e-3
LONGEST_NAME = 60  # of files and functions that are named after the robot
LONGEST_TEXT = 4000  # bytes: C99 promises strings of 4095
ONE_SIGNATURE = """/* CasADi's functions share one signature, of which not all is used. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
"""


@record(checked=True)
class RegressorCode:
    """C source of K_base(q, q̇, q̈), all joint coordinates given.

    Attributes
    ----------
    name : str
        What all its functions and macros begin with.
    header, source : str
        Contents of ``<name>.h`` and ``<name>.c``.
    """

    name: str
    header: str = field(repr=False)
    source: str = field(repr=False)

    def save(self, folder: str | Path) -> list[Path]:
        """Write both files, whole or not at all."""
        contents = {f"{self.name}.h": self.header, f"{self.name}.c": self.source}
        return write_files(folder, contents)


@checked
def regressor_code(
    model: ForceModel, *, name: str | None = None, values: FloatArray | None = None
) -> RegressorCode:
    """Generate C source of the base columns of a force model's regressor.

    ``int <name>_regressor(const double *q, const double *v, const double *a, double *K)`` fills
    K (dof, n) row by row, as ``ForceModel.regressor`` has it, from positions (nq,), velocities and
    accelerations (nv,) of all joints, in Pinocchio's order. It allocates nothing, keeps no state,
    and says where the pose is singular.

    Parameters
    ----------
    model : ForceModel
    name : str, optional
        A C identifier; by default made of the mechanism's name.
    values : FloatArray, optional
        (n,), base parameters to be put into the source beside the regressor.

    Raises
    ------
    MissingExtraError
        When CasADi is not installed.
    OptionError
        When the name is no identifier, or a joint has no symbolic form.
    DataError
        When there are not n finite values.
    """
    if find_spec("casadi") is None:
        raise MissingExtraError.of("casadi", "codegen")
    from loopid.export.symbolic import c_functions  # here, as it needs CasADi

    chosen = _identifier(model.mechanism.name) if name is None else name
    if not IDENTIFIER.fullmatch(chosen):
        raise OptionError(
            "the name of C functions must be letters and digits with single _ between them, not "
            f"{chosen!r}",
            given=chosen,
        )
    fields = _fields(model, chosen) | _value_fields(model, chosen, values)
    loops = "open.c" if fields["DEPENDENT"] == "0" else "closed.c"
    parts = (_filled(template, fields) for template in ("regressor.c", loops))
    functions = c_functions(model, f"{chosen}_casadi")
    source = "\n".join([f'#include "{chosen}.h"\n', ONE_SIGNATURE, functions, *parts])
    return RegressorCode(chosen, _filled("regressor.h", fields), source)


@checked
def export_regressor(
    model: ForceModel,
    folder: str | Path,
    *,
    name: str | None = None,
    values: FloatArray | None = None,
) -> list[Path]:
    """Write the C source and header of ``regressor_code`` to a folder.

    Parameters
    ----------
    model, name, values
        As in ``regressor_code``.
    folder : path
        Made where it is missing.

    Returns
    -------
    list of Path
        Of the header and of the source.

    Raises
    ------
    MissingExtraError, OptionError, DataError
        As ``regressor_code``.
    FileError
        When the files cannot be written.

    Examples
    --------
    >>> import loopid, tempfile
    >>> model = loopid.find_force_model(loopid.load_mechanism("five_bar"), joint_terms=None)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in loopid.export_regressor(model, folder)]
    ['five_bar.h', 'five_bar.c']
    """
    return regressor_code(model, name=name, values=values).save(folder)


def _identifier(name: str) -> str:
    """A C identifier that is like the name of a robot."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name)[:LONGEST_NAME].strip("_")
    return plain if IDENTIFIER.fullmatch(plain) else f"robot_{plain}".strip("_")


def _filled(template: str, fields: dict[str, str]) -> str:
    """A template with what is between @ signs filled in."""
    text = files("loopid.export").joinpath("templates", template).read_text(encoding="utf-8")
    return re.sub(r"@([A-Z_]+)@", lambda match: fields[match[1]], text)


def _fields(model: ForceModel, name: str) -> dict[str, str]:
    """Dimensions, tolerances and names that the templates are filled with."""
    mechanism = model.mechanism
    chosen, dependent = partition(mechanism)
    joints = [(joint, mechanism.joint(joint).nq) for joint in mechanism.joints]
    # A joint's name where it has one position, else numbered from 0.
    positions = [j if nq == 1 else f"{j}[{k}]" for j, nq in joints for k in range(nq)]
    return {
        "NAME": name,
        "GUARD": name.upper(),
        "ROBOT": _string(mechanism.name),
        "MODEL": model.model,
        "VERSION": version("loopid"),
        "NQ": str(mechanism.model.nq),
        "NV": str(mechanism.model.nv),
        "NV_ALL": str(len(dependent) + len(chosen)),
        "DOF": str(len(chosen)),
        "ROWS": str(mechanism.rows),
        "DEPENDENT": str(len(dependent)),
        "PARAMETERS": str(len(model.parameters)),
        "SINGULAR": repr(SINGULAR),
        "NEAR_SINGULARITY": repr(NEAR_SINGULARITY),
        "POSITION_NAMES": _strings(positions),
        "VELOCITY_NAMES": _strings(mechanism.coordinates),
        "ROW_NAMES": _strings(mechanism.independent),
        "PARAMETER_NAMES": _strings(model.parameters.labels),
        "PARAMETER_UNITS": _strings(parameter.unit for parameter in model.parameters),
        "PARAMETER_EXPRESSIONS": _strings(model.base.expressions),
    }


def _value_fields(model: ForceModel, name: str, values: FloatArray | None) -> dict[str, str]:
    """Values of the base parameters (n,) as a constant, where they are given."""
    if values is None:
        return {"VALUES": "", "VALUES_DECLARATION": ""}
    phi, count = finite(values, "base parameters"), len(model.parameters)
    if phi.shape != (count,):
        raise DataError(
            f"base parameters must have shape ({count},), not {phi.shape}", shape=phi.shape
        )
    declared = f"const double {name}_values[{name.upper()}_PARAMETERS]"
    listed = ",\n    ".join(map(repr, phi.tolist()))
    return {
        "VALUES": f"{declared} = {{\n    {listed}}};\n",
        "VALUES_DECLARATION": f"/* Identified values of phi. */\nextern {declared};\n",
    }


def _strings(texts: Iterable[str]) -> str:
    return ",".join(f"\n    {_string(text)}" for text in texts)


def _string(text: str) -> str:
    """A C string; every character but plain ones by its octal codes.

    Names come from files of any origin. They stand in strings only: in comments, a backslash at the
    end of a line or a trigraph would let them out.
    """
    codes = text.encode("utf-8", "backslashreplace")
    if len(codes) > LONGEST_TEXT:
        codes = codes[: LONGEST_TEXT - 3] + b"..."
    plain = (chr(c) if 32 <= c < 127 and chr(c) not in '"\\?' else f"\\{c:03o}" for c in codes)
    return f'"{"".join(plain)}"'
