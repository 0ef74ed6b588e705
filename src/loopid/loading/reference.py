"""The reference configuration as the robot file writes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.errors import RobotFileError


def written_reference(file: Path, model: pin.Model, values: dict[str, float]) -> FloatArray:
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
        if joint.nv != 1:
            raise RobotFileError(f"{file}: joint {name} in reference is not one number")
        if not np.isfinite(value):
            raise RobotFileError(f"{file}: joint {name} in reference must be finite, not {value}")
        write_joint(joint, q, value)
    return np.asarray(q, dtype=np.float64)


def write_joint(joint: pin.JointModel, q: FloatArray, value: float) -> None:
    """Put the value of a joint with one coordinate into a configuration, in place."""
    turned = joint.nq == 2
    coordinates = [np.cos(value), np.sin(value)] if turned else [value]
    q[joint.idx_q : joint.idx_q + joint.nq] = coordinates
