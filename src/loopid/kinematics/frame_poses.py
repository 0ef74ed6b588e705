"""Frames carried by the joints of a tree; components first and samples last, as in ``tree``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.kinematics.layout import joint_layout
from loopid.kinematics.per_mechanism import per_mechanism
from loopid.kinematics.tree import TreeMotion, TreePose
from loopid.kinematics.vectors import cross
from loopid.mechanism import Mechanism


@dataclass(frozen=True)
class FrameSet:
    """What is constant of F frames.

    Attributes
    ----------
    places : IntArray
        (F,), of the joints that carry them in the joint layout; 0 for frames on the ground.
    grounded : BoolArray
        (F,), whether the ground carries them.
    rotation, translation : FloatArray
        (3, 3, F) and (3, F), in the frame of that joint.
    frames, coordinates : IntArray
        (P,) pairs of a frame and a coordinate that moves it, frame by frame; coordinates are
        positions in the layout's ``coordinates``.
    spans : tuple of slice
        The pairs of each frame.
    """

    places: IntArray
    grounded: BoolArray
    rotation: FloatArray
    translation: FloatArray
    frames: IntArray
    coordinates: IntArray
    spans: tuple[slice, ...]


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


def frame_set(mechanism: Mechanism, frame_ids: tuple[int, ...]) -> FrameSet:
    """Look frames up by their indices in the Pinocchio model."""
    known = _known_sets(mechanism)
    if frame_ids not in known:
        known[frame_ids] = _frame_set(mechanism, frame_ids)
    return known[frame_ids]


@per_mechanism
def _known_sets(mechanism: Mechanism) -> dict[tuple[int, ...], FrameSet]:
    """The sets asked for so far."""
    return {}


def _frame_set(mechanism: Mechanism, frame_ids: tuple[int, ...]) -> FrameSet:
    layout, frames = joint_layout(mechanism), [mechanism.model.frames[k] for k in frame_ids]
    place = {int(joint): k for k, joint in enumerate(layout.joint_ids)}
    nothing = np.empty(0, dtype=np.int64)
    paths = [
        layout.paths[place[frame.parentJoint]] if frame.parentJoint else nothing for frame in frames
    ]
    ends = np.cumsum([0, *map(len, paths)])
    placements = [frame.placement for frame in frames]
    return FrameSet(
        places=np.array([place.get(frame.parentJoint, 0) for frame in frames], dtype=np.int64),
        grounded=np.array([frame.parentJoint == 0 for frame in frames], dtype=bool),
        rotation=np.array([p.rotation for p in placements]).reshape(-1, 3, 3).transpose(1, 2, 0),
        translation=np.array([p.translation for p in placements]).reshape(-1, 3).T,
        frames=np.repeat(np.arange(len(frames)), [len(path) for path in paths]),
        coordinates=np.concatenate([nothing, *paths]),
        spans=tuple(slice(int(a), int(b)) for a, b in pairwise(ends)),
    )


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
