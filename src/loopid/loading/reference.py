"""The reference configuration: read it, close the loops at it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray, IntArray
from loopid.errors import RobotFileError
from loopid.kinematics.assembly import CLOSURE_TOLERANCE
from loopid.kinematics.frames import integrate
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.measured import scaled_constraint
from loopid.kinematics.projection import partition
from loopid.kinematics.scaling import coordinate_scales
from loopid.mechanism import Mechanism

GAUSS_NEWTON_STEPS = 100
LONGEST_STEP = 0.3  # rad or characteristic lengths


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
        _write(joint, q, value)
    return np.asarray(q, dtype=np.float64)


def _write(joint: pin.JointModel, q: FloatArray, value: float) -> None:
    turned = joint.nq == 2
    coordinates = [np.cos(value), np.sin(value)] if turned else [value]
    q[joint.idx_q : joint.idx_q + joint.nq] = coordinates


def close_reference(mechanism: Mechanism, given: bool) -> Mechanism:
    """The mechanism with its loops closed at the reference.

    Motors stay where the file puts them and passive joints move; where the file gives no
    reference, all joints may move.

    Raises
    ------
    RobotFileError
        With the residual that is left and the closure that stays open most.
    """
    everything = np.arange(mechanism.model.nv)
    _, passive = partition(mechanism)
    for movable in (passive,) if given else (passive, everything):
        q = _gauss_newton(mechanism, mechanism.reference, movable)
        residual = np.abs(scaled_constraint(mechanism, q[None])[0][0])
        if residual.max(initial=0.0) <= CLOSURE_TOLERANCE:
            return replace(mechanism, reference=q)
    names = [closure.name for closure in mechanism.closures for _ in range(closure.rows)]
    origin = "the reference cannot be closed" if given else "no closed configuration was found"
    hint = "" if given else ", give one as 'reference'"
    raise RobotFileError(
        f"{mechanism.path}: {origin}: closure {names[int(residual.argmax())]} stays open by "
        f"{residual.max():.1e} m (tolerance {CLOSURE_TOLERANCE:g} m){hint}"
    )


def _gauss_newton(mechanism: Mechanism, q: FloatArray, movable: IntArray) -> FloatArray:
    """Shrink the residual by steps of limited length of the movable coordinates."""
    scales = coordinate_scales(mechanism)[movable]
    for _ in range(GAUSS_NEWTON_STEPS):
        residual, jacobian = scaled_constraint(mechanism, q[None])
        factors = Factorisation.of(jacobian[:, :, movable])
        step = -factors.solve(residual[:, :, None])[0, :, 0]
        longest = np.abs(step).max(initial=0.0)
        tangent = np.zeros(mechanism.model.nv)
        tangent[movable] = scales * step * min(1.0, LONGEST_STEP / max(longest, 1e-300))
        q = integrate(mechanism, q[None], tangent[None])[0]
        if longest < 1e-15:
            break
    return q
