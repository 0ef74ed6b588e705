"""Closures and platform of a robot file, with their frames looked up in the model."""

from __future__ import annotations

from pathlib import Path

import pinocchio as pin

from loopid.errors import RobotFileError
from loopid.loading.description import Description, PlatformDescription
from loopid.mechanism import LoopClosure, Platform


def find_closures(
    file: Path, model: pin.Model, description: Description
) -> tuple[LoopClosure, ...]:
    """The closures of a description, each between two bodies of the model."""
    pairs = zip(description.closed_loop, description.type, strict=True)
    return tuple(_closure(file, model, kind, *frames) for frames, kind in pairs)


def _closure(file: Path, model: pin.Model, kind: str, frame_a: str, frame_b: str) -> LoopClosure:
    ids = (_frame(file, model, frame_a), _frame(file, model, frame_b))
    joints = [model.frames[frame].parentJoint for frame in ids]
    if joints[0] == joints[1]:
        raise RobotFileError(
            f"{file}: closure {frame_a}-{frame_b} joins two frames of one body: it closes no loop"
        )
    return LoopClosure(kind, frame_a, frame_b, ids)


def _frame(file: Path, model: pin.Model, name: str) -> int:
    links = link_frames(model)
    if name in links:
        return links[name]
    # Joints have frames too; a link of the same name comes first.
    for frame_id, frame in enumerate(model.frames):
        if frame.name == name:
            return frame_id
    raise RobotFileError(f"{file}: unknown frame {name!r}: choose among {', '.join(links)}")


def link_frames(model: pin.Model) -> dict[str, int]:
    """Indices of the frames of all links, by name."""
    frames = enumerate(model.frames)
    return {frame.name: i for i, frame in frames if frame.type == pin.FrameType.BODY}


def find_platform(
    file: Path, model: pin.Model, description: PlatformDescription | None
) -> Platform | None:
    """The platform of a description, where it declares one."""
    if description is None:
        return None
    frame_id = _frame(file, model, description.frame)
    names, motions = tuple(description.coordinates), tuple(description.coordinates.values())
    return Platform(description.frame, frame_id, names, motions)
