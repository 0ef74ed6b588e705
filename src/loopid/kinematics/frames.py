"""Placements, Jacobians and accelerations of frames over many samples.

The only place that asks Pinocchio for kinematics. Velocities of frames are those of their
origins, with axes along the fixed frame (``LOCAL_WORLD_ALIGNED``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray, samples
from loopid.mechanism import Mechanism

AXES = pin.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True)
class FrameKinematics:
    """What F frames do at N samples.

    Attributes
    ----------
    rotation : FloatArray
        (N, F, 3, 3), columns are the frame's axes in the fixed frame.
    origin : FloatArray
        (N, F, 3) in m.
    jacobian : FloatArray
        (N, F, 6, nv): linear velocity of the origin above angular velocity.
    """

    rotation: FloatArray
    origin: FloatArray
    jacobian: FloatArray


def frame_kinematics(
    mechanism: Mechanism, configurations: FloatArray, frame_ids: Sequence[int]
) -> FrameKinematics:
    """Placements and Jacobians of frames at configurations (N, nq)."""
    model = mechanism.model
    data, q = model.createData(), samples(configurations, model.nq, "configurations")
    shape = (len(q), len(frame_ids))
    rotation, origin = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
    jacobian = np.empty((*shape, 6, model.nv))
    for k, configuration in enumerate(q):
        pin.computeJointJacobians(model, data, configuration)
        for f, frame in enumerate(frame_ids):
            placement = pin.updateFramePlacement(model, data, frame)
            rotation[k, f], origin[k, f] = placement.rotation, placement.translation
            jacobian[k, f] = pin.getFrameJacobian(model, data, frame, AXES)
    return FrameKinematics(rotation, origin, jacobian)


def frame_accelerations(
    mechanism: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    frame_ids: Sequence[int],
) -> FloatArray:
    """Accelerations of frames at zero joint acceleration: the time derivative of J times v.

    Returns
    -------
    FloatArray
        (N, F, 6): classical acceleration of the origin above angular acceleration.
    """
    model = mechanism.model
    data, q = model.createData(), samples(configurations, model.nq, "configurations")
    v, rest = samples(velocities, model.nv, "velocities", len(q)), np.zeros(model.nv)
    accelerations = np.empty((len(q), len(frame_ids), 6))
    for k in range(len(q)):
        pin.forwardKinematics(model, data, q[k], v[k], rest)
        for f, frame in enumerate(frame_ids):
            pin.updateFramePlacement(model, data, frame)
            motion = pin.getFrameClassicalAcceleration(model, data, frame, AXES)
            accelerations[k, f] = motion.vector
    return accelerations


def integrate(mechanism: Mechanism, configurations: FloatArray, steps: FloatArray) -> FloatArray:
    """Configurations (N, nq) moved by tangent steps (N, nv)."""
    model = mechanism.model
    if model.nq == model.nv:
        return np.asarray(configurations + steps, dtype=np.float64)
    pairs = zip(configurations, steps, strict=True)
    return np.stack([pin.integrate(model, q, step) for q, step in pairs])
