"""Frames carried by the joints of a tree; components first and samples last, as in ``tree``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.frame_sets import FrameSet
from loopid.kinematics.tree import TreeMotion, TreePose
from loopid.kinematics.vectors import cross


@dataclass(frozen=True)
class FramePoses:
    """Frames at the poses of a tree; each quantity is found when it is first asked for."""

    tree: TreePose
    frames: FrameSet

    @cached_property
    def origin(self) -> FloatArray:
        """(3, F, N) in m."""
        frames, tree = self.frames, self.tree
        R = tree.rotation[:, :, frames.places]
        origin = np.einsum("ijfn,jf->ifn", R, frames.translation)
        origin += tree.origin[:, frames.places]
        origin[:, frames.grounded] = frames.translation[:, frames.grounded, None]
        return np.asarray(origin, dtype=np.float64)

    @cached_property
    def arm(self) -> FloatArray:
        """(3, F, N), from the pole to the frame's origin."""
        return self.origin - self.tree.pole[:, None]

    @cached_property
    def rotation(self) -> FloatArray:
        """(3, 3, F, N), columns are the frame's axes in the fixed frame."""
        R = self.tree.rotation[:, :, self.frames.places]
        rotation = np.einsum("ijfn,jkf->ikfn", R, self.frames.rotation)
        ground = self.frames.grounded
        rotation[:, :, ground] = self.frames.rotation[:, :, ground, None]
        return np.asarray(rotation, dtype=np.float64)

    @cached_property
    def columns(self) -> FloatArray:
        """(6, P, N), twist of the tree's joints at the pole, pair by pair."""
        return self.tree.axes[:, self.frames.coordinates]

    @property
    def angular_columns(self) -> FloatArray:
        """(3, P, N), angular velocity of the frame per unit of the coordinate."""
        return self.columns[:3]

    @cached_property
    def linear_columns(self) -> FloatArray:
        """(3, P, N), velocity of the frame's origin per unit of the coordinate."""
        moved = cross(self.columns[:3], self.arm[:, self.frames.frames])
        moved += self.columns[3:]
        return moved


@dataclass(frozen=True)
class FrameMotions:
    """Velocities and accelerations of frames, all (3, F, N).

    Attributes
    ----------
    velocity, acceleration : FloatArray
        Of the origins.
    turn, turning : FloatArray
        Angular.
    """

    velocity: FloatArray
    acceleration: FloatArray
    turn: FloatArray
    turning: FloatArray


def frame_motions(poses: FramePoses, motion: TreeMotion) -> FrameMotions:
    """Motion of frames that the joints carry, accelerations at zero joint acceleration."""
    frames, arm = poses.frames, poses.arm
    twist, bias = motion.twist[:, frames.places], motion.bias[:, frames.places]
    twist[:, frames.grounded] = bias[:, frames.grounded] = 0.0
    turn, turning = twist[:3], bias[:3]
    velocity = twist[3:] + cross(turn, arm)
    # The origin's own acceleration, from that of the body's point at the pole.
    acceleration = bias[3:] + cross(turning, arm)
    acceleration += cross(turn, velocity)
    return FrameMotions(velocity, acceleration, turn, turning)
