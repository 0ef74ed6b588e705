"""What every reader of a tree hands over: Pinocchio's model and what its file says beside."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pinocchio as pin

from loopid.loading.description import Description


@dataclass(frozen=True)
class TreeSource:
    """An open tree as read from a file, before joints are replaced or locked.

    Attributes
    ----------
    name : str
        Of the robot.
    file : Path
        Where the tree was read; named in messages.
    model : pinocchio.Model
        With a frame of type ``BODY`` for every link, named like it, and ``OP_FRAME`` frames for
        whatever the description's closures join beyond links.
    inertial_links : tuple of str
        Links with inertia, in the order of the file.
    child_links : dict
        Joint name to the link that it carries.
    description : Description
        What the file itself says of closures, motors and reference.
    notes : tuple of str
        What the file says and the model leaves out, such as springs: warned of on loading.
    """

    name: str
    file: Path
    model: pin.Model
    inertial_links: tuple[str, ...]
    child_links: dict[str, str]
    description: Description = field(default_factory=Description)
    notes: tuple[str, ...] = ()


def add_frame(model: pin.Model, name: str, link: str, placement: pin.SE3) -> None:
    """Mount a frame at a placement in a link, for a closure to join."""
    carrier = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    joint, there = carrier.parentJoint, carrier.placement * placement
    index = model.getFrameId(link, pin.FrameType.BODY)
    model.addFrame(pin.Frame(name, joint, index, there, pin.FrameType.OP_FRAME), False)
