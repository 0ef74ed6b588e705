"""What the templates of the C files are filled with: dimensions, names and values."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.metadata import version

from loopid.arrays import FloatArray
from loopid.experiment import ForceModel
from loopid.kinematics import partition
from loopid.robot import Mechanism

# Of the pivots: below the first there is no regressor, below the second it is ill-determined.
SINGULAR, NEAR_SINGULARITY = 1e-10, 1e-3


def source_fields(model: ForceModel, name: str, values: FloatArray | None) -> dict[str, str]:
    """Texts of all fields."""
    mechanism = model.mechanism
    chosen, dependent = partition(mechanism)
    labels = model.parameters.labels
    return {
        "NAME": name,
        "GUARD": name.upper(),
        "ROBOT": _comment(mechanism.name),
        "MODEL": model.model,
        "VERSION": version("loopid"),
        "NQ": str(mechanism.model.nq),
        "NV": str(mechanism.model.nv),
        "NV_ALL": str(len(dependent) + len(chosen)),
        "DOF": str(len(chosen)),
        "ROWS": str(mechanism.rows),
        "DEPENDENT": str(len(dependent)),
        "PARAMETERS": str(len(labels)),
        "SINGULAR": repr(SINGULAR),
        "NEAR_SINGULARITY": repr(NEAR_SINGULARITY),
        "ROW_COMMENTS": _listed(f"force along {row}" for row in mechanism.independent),
        "COLUMN_COMMENTS": _listed(_columns(model)),
        "POSITION_NAMES": _strings(position_names(mechanism)),
        "VELOCITY_NAMES": _strings(mechanism.coordinates),
        "ROW_NAMES": _strings(mechanism.independent),
        "PARAMETER_NAMES": _strings(labels),
        **_values(name, values),
    }


def position_names(mechanism: Mechanism) -> tuple[str, ...]:
    """A name for each position: the joint's where it has only one, else numbered from 0."""
    joints = [(name, mechanism.joint(name).nq) for name in mechanism.joints]
    return tuple(
        name if count == 1 else f"{name}[{k}]" for name, count in joints for k in range(count)
    )


def _columns(model: ForceModel) -> Iterable[str]:
    for parameter, expression in zip(model.parameters, model.base.expressions, strict=True):
        yield f"{parameter.label} [{parameter.unit}] = {expression}"


def _values(name: str, values: FloatArray | None) -> dict[str, str]:
    if values is None:
        return {"VALUES": "", "VALUES_DECLARATION": ""}
    declared = f"const double {name}_values[{name.upper()}_PARAMETERS]"
    listed = ",\n    ".join(repr(float(value)) for value in values)
    return {
        "VALUES_DECLARATION": f"/* Identified values of phi. */\nextern {declared};\n",
        "VALUES": f"{declared} = {{\n    {listed}}};\n",
    }


def _listed(texts: Iterable[str]) -> str:
    return "\n".join(f"     {k}: {_comment(text)}" for k, text in enumerate(texts))


def _comment(text: str) -> str:
    """Text that does not end the comment that it is in."""
    return text.replace("*/", "* /").replace("/*", "/ *")


def _strings(texts: Sequence[str]) -> str:
    return "\n    " + ",\n    ".join(_string(text) for text in texts)


def _string(text: str) -> str:
    """A C string; every character but plain ones by its octal codes."""
    plain = "".join(
        chr(byte) if 32 <= byte < 127 and chr(byte) not in '"\\?' else f"\\{byte:03o}"
        for byte in text.encode()
    )
    return f'"{plain}"'
