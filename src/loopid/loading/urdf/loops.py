"""``<loop>`` tags of URDF+: joints that close loops [Chignoli2024]."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription
from loopid.loading.source import add_frame
from loopid.loading.urdf.ends import SIDES, ends, named_tags
from loopid.loading.urdf.markup import Element, label, numbers
from loopid.loading.urdf.tags import LEAST_AXIS

KINDS = {
    "continuous": "hinge",
    "cylindrical": "cylindrical",
    "fixed": "6d",
    "prismatic": "prismatic",
    "revolute": "hinge",
    "spherical": "3d",
}
AXIAL = ("hinge", "cylindrical", "prismatic")


def read_loops(root: Element, model: pin.Model) -> list[ClosureDescription]:
    """Closures of the ``<loop>`` tags, their frames mounted in the model.

    A loop ``x`` joins the frames ``x_predecessor`` and ``x_successor``, at the origins that it
    gives in its two links. Its axis has the same components in both.

    Raises
    ------
    RobotFileError
        Naming the loop, the tag and the value.
    """
    return [_read(loop, model) for loop in named_tags(root, "loop")]


def _read(loop: Element, model: pin.Model) -> ClosureDescription:
    kind = KINDS.get(loop.get("type", ""))
    if kind is None:
        what, listed = f"{label(loop)}: unknown type {loop.get('type', '')!r}", ", ".join(KINDS)
        raise RobotFileError(f"{what}: choose among {listed}")
    links = ends(loop, [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY])
    try:
        axis = _axis(loop) if kind in AXIAL else None
        frames = [_mount(loop, side, link, model) for side, link in zip(SIDES, links, strict=True)]
    except RobotFileError as error:
        raise RobotFileError(f"{label(loop)}: {error}") from error
    content = {"type": kind, "frames": frames, "axes": axis and (axis, axis)}
    return ClosureDescription.model_validate({k: v for k, v in content.items() if v is not None})


def _axis(loop: Element) -> tuple[float, ...]:
    axis = loop.find("axis")
    if axis is None:
        raise RobotFileError("<axis> is missing")
    values = numbers(axis, "xyz", 3)
    if max(map(abs, values)) < LEAST_AXIS:
        raise RobotFileError("<axis> is zero")
    return values


def _mount(loop: Element, side: str, link: str, model: pin.Model) -> str:
    """Add the frame of one side to the model; gives its name."""
    name = f"{loop.get('name', '').strip()}_{side}"
    if any(frame.name == name for frame in model.frames):
        raise RobotFileError(
            f"its frame cannot be called {name!r}, which is taken: rename the loop"
        )
    add_frame(model, name, link, _placement(loop.find(f"{side}/origin")))
    return name


def _placement(origin: Element | None) -> pin.SE3:
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (np.array(numbers(origin, key, 3, "0 0 0")) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
