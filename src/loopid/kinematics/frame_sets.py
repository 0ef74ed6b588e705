"""What is constant of frames that the joints of a tree carry."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.kinematics.layout import joint_layout
from loopid.kinematics.per_mechanism import per_mechanism
from loopid.robot import Mechanism


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
