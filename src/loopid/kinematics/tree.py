"""Forward kinematics of the whole tree, for all samples at once [Featherstone2008, ch. 4].

Arrays hold components first, along the fixed axes, and samples last. Twists and accelerations
are spatial vectors (6, ...): the angular part above the linear one at the *pole*, one point for
all bodies that differs from sample to sample only, so that bodies add up without being shifted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.kinematics.joint_frames import (
    OtherJoints,
    coordinate_axes,
    joint_placements,
    other_accelerations,
    other_joints,
)
from loopid.kinematics.layout import JointLayout, joint_layout
from loopid.kinematics.vectors import by_place, cross, rotated
from loopid.robot import Mechanism


@dataclass(frozen=True)
class TreePose:
    """Where the J joints' frames are at N samples.

    Attributes
    ----------
    model : pin.Model
    layout : JointLayout
        The order of joints and coordinates.
    configurations : FloatArray
        (N, nq).
    rotation : FloatArray
        (3, 3, J, N), columns are the frame's axes.
    origin : FloatArray
        (3, J, N).
    others : OtherJoints
        Those of them that are not described by an angle or a displacement.
    """

    model: pin.Model
    layout: JointLayout
    configurations: FloatArray
    rotation: FloatArray
    origin: FloatArray
    others: OtherJoints

    @property
    def pole(self) -> FloatArray:
        """(3, N): the first joint, so that a robot far from the fixed origin loses no digits."""
        return self.origin[:, 0]

    @cached_property
    def axes(self) -> FloatArray:
        """(6, nv, N), twist per unit of each coordinate."""
        axes = coordinate_axes(self.layout, self.rotation, self.others)
        arms = (self.origin - self.origin[:, :1])[:, self.layout.owners]
        axes[3:] += cross(arms, axes[:3])
        return axes


@dataclass(frozen=True)
class TreeMotion:
    """Twists of the joints, and their accelerations at zero joint acceleration, (6, J, N)."""

    twist: FloatArray
    bias: FloatArray


def tree_pose(mechanism: Mechanism, q: FloatArray) -> TreePose:
    """Place all joints at configurations (N, nq)."""
    model, layout = mechanism.model, joint_layout(mechanism)
    others = other_joints(model, layout, q)
    rotation, origin = joint_placements(layout, q, others)
    for level, parents in layout.levels:
        R = rotation[:, :, parents]
        origin[:, level] = origin[:, parents] + rotated(R, origin[:, level])
        rotation[:, :, level] = np.einsum("ijkn,jlkn->ilkn", R, rotation[:, :, level])
    return TreePose(model, layout, q, rotation, origin, others)


def joint_twists(pose: TreePose, motions: FloatArray) -> FloatArray:
    """Twists (6, J, c, N) of all joints in c motions (nv, c, N) of the tree's coordinates."""
    coordinates, (_, count, samples) = pose.layout.coordinates, motions.shape
    own = np.moveaxis(by_place(6, count, len(coordinates), samples), 1, 2)
    np.multiply(pose.axes[:, :, None], motions[coordinates], out=own)
    return _carried(pose.layout, _by_joint(pose.layout, own))


def tree_motion(pose: TreePose, velocities: FloatArray) -> TreeMotion:
    """The motion of all joints at velocities (nv, N).

    A joint's axes move with it: their rate of change is the cross product with its twist.
    """
    layout = pose.layout
    own = _by_joint(layout, pose.axes * velocities[layout.coordinates])
    twist = _carried(layout, own.copy())
    bias = np.empty_like(twist)
    bias[:3] = cross(twist[:3], own[:3])
    bias[3:] = cross(twist[:3], own[3:])
    bias[3:] += cross(twist[3:], own[:3])
    if len(layout.other):
        _add_changes(pose, velocities, bias)
    return TreeMotion(twist, _carried(layout, bias))


def _add_changes(pose: TreePose, velocities: FloatArray, bias: FloatArray) -> None:
    """Add the accelerations of joints whose axes change in their own frame too."""
    k = pose.layout.other
    own = other_accelerations(pose.model, pose.layout, pose.configurations, velocities.T)
    R, arms = pose.rotation[:, :, k], pose.origin[:, k] - pose.pole[:, None]
    angular, linear = (rotated(R, part) for part in own)
    bias[:3, k] += angular
    bias[3:, k] += linear + cross(arms, angular)


def _carried(layout: JointLayout, vectors: FloatArray) -> FloatArray:
    """Sums along the paths from the root, in place, of vectors (6, J, ...) of the joints."""
    for level, parents in layout.levels:
        vectors[:, level] += vectors[:, parents]
    return vectors


def _by_joint(layout: JointLayout, columns: FloatArray) -> FloatArray:
    """Sums (6, J, ...) over each joint's coordinates of vectors (6, nv, ...)."""
    if len(layout.owners) == len(layout.joint_ids):
        return columns
    sums = np.zeros((6, len(layout.joint_ids), *columns.shape[2:]))
    for k, owner in enumerate(layout.owners):
        sums[:, owner] += columns[:, k]
    return sums
