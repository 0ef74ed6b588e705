"""The reference configuration as the robot file writes it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.errors import RobotFileError

# Of a joint with one coordinate its value, of another one its part of the configuration.
Reference = float | list[float]
LARGEST = 1e100  # as for the numbers of a URDF


def written_reference(file: Path, model: pin.Model, values: Mapping[str, Reference]) -> FloatArray:
    """Configuration (nq,) with the given joint values; others in the middle of their limits."""
    q = pin.neutral(model)
    simple = [joint for joint in list(model.joints)[1:] if joint.nq == 1]
    for joint in simple:
        low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
        if not low <= q[joint.idx_q] <= high:
            q[joint.idx_q] = 0.5 * (low + high)
    for name, value in values.items():
        if not model.existJointName(name):
            listed = ", ".join(list(model.names)[1:])
            raise RobotFileError(
                f"{file}: unknown joint {name!r} in reference: choose among {listed}"
            )
        joint = model.joints[model.getJointId(name)]
        _write(f"{file}: joint {name} in reference", joint, q, value)
    return np.asarray(q, dtype=np.float64)


def _write(what: str, joint: pin.JointModel, q: FloatArray, value: Reference) -> None:
    given = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if not (np.abs(given) < LARGEST).all():
        raise RobotFileError(f"{what} must be finite and below {LARGEST:g}, not {value}")
    wanted = 1 if joint.nv == 1 else joint.nq
    if len(given) != wanted:
        count = "one number" if wanted == 1 else f"a list of {wanted} numbers"
        raise RobotFileError(f"{what} must be {count}, not {value}")
    if joint.nv == 1:
        write_joint(joint, q, float(given[0]))
    else:
        q[joint.idx_q : joint.idx_q + joint.nq] = _unit_rotation(what, joint, given)


def _unit_rotation(what: str, joint: pin.JointModel, values: FloatArray) -> FloatArray:
    """Values of a joint with its quaternion, or cosine and sine, made a unit vector."""
    parts = {"JointModelSpherical": 0, "JointModelFreeFlyer": 3, "JointModelPlanar": 2}
    first = parts.get(joint.shortname(), len(values))
    size = float(np.linalg.norm(values[first:])) if first < len(values) else 1.0
    if not 0.9 < size < 1.1:
        raise RobotFileError(f"{what} must end in a unit vector, not one of length {size:.3g}")
    return np.append(values[:first], values[first:] / size)


def read_joint(joint: pin.JointModel, q: FloatArray) -> float:
    """Value of a joint with one coordinate in a configuration."""
    first = joint.idx_q
    return float(np.arctan2(q[first + 1], q[first]) if joint.nq == 2 else q[first])


def write_joint(joint: pin.JointModel, q: FloatArray, value: float) -> None:
    """Put the value of a joint with one coordinate into a configuration, in place."""
    turned = joint.nq == 2
    coordinates = [np.cos(value), np.sin(value)] if turned else [value]
    q[joint.idx_q : joint.idx_q + joint.nq] = coordinates
