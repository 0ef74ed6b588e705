"""Placements, Jacobians and accelerations of frames over many samples.

Velocities of frames are those of their origins, with axes along the fixed frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray, samples
from loopid.kinematics.blocks import in_blocks
from loopid.kinematics.frame_poses import FramePoses, frame_motions
from loopid.kinematics.frame_sets import frame_set
from loopid.kinematics.tree import tree_motion, tree_pose
from loopid.robot import Mechanism


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
    q = samples(configurations, mechanism.model.nq, "configurations")
    frames = frame_set(mechanism, tuple(frame_ids))

    def values(rows: slice) -> tuple[FloatArray, ...]:
        tree = tree_pose(mechanism, q[rows])
        poses = FramePoses(tree, frames)
        jacobian = np.zeros((len(frame_ids), 6, mechanism.model.nv, len(q[rows])))
        columns = tree.layout.coordinates[frames.coordinates]
        jacobian[frames.frames, :3, columns] = np.moveaxis(poses.linear_columns, 0, 1)
        jacobian[frames.frames, 3:, columns] = np.moveaxis(poses.angular_columns, 0, 1)
        return np.moveaxis(poses.rotation, 2, 0), np.moveaxis(poses.origin, 1, 0), jacobian

    return FrameKinematics(*in_blocks(len(q), values))


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
    q = samples(configurations, model.nq, "configurations")
    v = samples(velocities, model.nv, "velocities", len(q))
    frames = frame_set(mechanism, tuple(frame_ids))

    def values(rows: slice) -> tuple[FloatArray, ...]:
        tree = tree_pose(mechanism, q[rows])
        moving = frame_motions(FramePoses(tree, frames), tree_motion(tree, v[rows].T))
        both = np.concatenate([moving.acceleration, moving.turning])
        return (np.moveaxis(both, 1, 0),)

    return in_blocks(len(q), values)[0]


def integrate(mechanism: Mechanism, configurations: FloatArray, steps: FloatArray) -> FloatArray:
    """Configurations (N, nq) moved by tangent steps (N, nv)."""
    model = mechanism.model
    if model.nq == model.nv:
        return np.asarray(configurations + steps, dtype=np.float64)
    pairs = zip(configurations, steps, strict=True)
    return np.stack([pin.integrate(model, q, step) for q, step in pairs])
