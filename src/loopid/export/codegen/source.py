"""The regressor as a C file and its header."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from loopid.arguments import checked, checked_fields
from loopid.arrays import FloatArray, finite
from loopid.errors import DataError, MissingExtraError, OptionError
from loopid.experiment import ForceModel
from loopid.export.codegen.fields import source_fields
from loopid.export.codegen.texts import CLOSED, HEADER, OPEN
from loopid.files import write_files

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")  # as CasADi has it


@checked_fields
@dataclass(frozen=True)
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
    header: str
    source: str

    def save(self, folder: str | Path) -> list[Path]:
        """Write both files, whole or not at all."""
        contents = {f"{self.name}.h": self.header, f"{self.name}.c": self.source}
        return write_files(folder, contents)


@checked
def regressor_code(
    model: ForceModel, name: str | None = None, values: FloatArray | None = None
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
    """
    if find_spec("casadi") is None:
        raise MissingExtraError("casadi", "codegen")
    from loopid.export.codegen.functions import c_functions  # here, as it needs CasADi

    chosen = _identifier(model.mechanism.name) if name is None else name
    if not IDENTIFIER.fullmatch(chosen):
        raise OptionError(
            "the name of C functions must be letters and digits with single _ between them, not "
            f"{chosen!r}"
        )
    fields = source_fields(model, chosen, _checked(values, len(model.parameters)))
    template = OPEN
    if fields["DEPENDENT"] != "0":
        solver = files("loopid.export.codegen").joinpath("solve.c").read_text(encoding="utf-8")
        template = f"{solver}\n{CLOSED}"
    functions = c_functions(model, f"{chosen}_casadi")
    source = f'#include "{chosen}.h"\n\n{functions}\n{_filled(template, fields)}'
    return RegressorCode(chosen, _filled(HEADER, fields), source)


@checked
def export_regressor(
    model: ForceModel,
    folder: str | Path,
    name: str | None = None,
    values: FloatArray | None = None,
) -> list[Path]:
    """Write the C source and header of ``regressor_code`` to a folder.

    Raises
    ------
    MissingExtraError, OptionError, DataError, OutputError
    """
    return regressor_code(model, name, values).save(folder)


def _identifier(name: str) -> str:
    """A C identifier made of a robot's name."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return plain if IDENTIFIER.fullmatch(plain) else f"robot_{plain}".strip("_")


def _checked(values: FloatArray | None, count: int) -> FloatArray | None:
    if values is None:
        return None
    phi = finite(values, "base parameters")
    if phi.shape != (count,):
        raise DataError(f"base parameters must have shape ({count},), not {phi.shape}")
    return phi


def _filled(template: str, fields: Mapping[str, str]) -> str:
    return re.sub(r"@([A-Z_]+)@", lambda match: fields[match[1]], template)
