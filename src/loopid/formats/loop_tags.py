"""What closes loops in a URDF: tags with a type or a ball, and links by their names."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.errors import RobotFileError, naming
from loopid.loading.description import ClosureDescription
from loopid.loading.urdf import PARENT_CHILD, Dialect, closure_of, linked, mounted
from loopid.loading.urdf_tree import UrdfFile
from loopid.loading.xml_elements import inner_tags, label, named_tags, numbers, placement, said
from loopid.robot.robot import LeftOut

# Tags that name the links, where the place in a link stands, with {} for its side, and axes as of
# ``closure_of``.
LOOP_TAGS: dict[str, tuple[tuple[str, str], str, tuple[str, str] | str]] = {
    "loop": (("predecessor", "successor"), "{}/origin", "axis"),  # URDF+ [Chignoli2024]
    "loop_joint": (("link1", "link2"), "{}", "axis"),  # Isaac Sim
    "constraint": (PARENT_CHILD, "{}_origin", ("parent_axis", "child_axis")),  # urdfdom's 264
}
CLOSING_FRAME = re.compile(r"closing_(.+)_([12])")
Z = (0.0, 0.0, 1.0)
BALL = "ball_constraint"
PULLING = ("linear_bushing_rpy", "linear_spring_damper")


def read_loop_tags(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures of tags with a type, and a placement in either link."""
    closures = []
    for tag, (sides, origin, axes) in LOOP_TAGS.items():
        for element in named_tags(urdf.root, tag):
            for repeated in element.findall("link1")[1:]:
                repeated.tag = "link2"  # Isaac Sim's manual writes <link1> twice
            with naming(label(element)):
                first, second = (placement(element.find(origin.format(side))) for side in sides)
                links, places = linked(urdf, element, sides), (first, second)
                closures.append(closure_of(model, element, links, places, sides=sides, axes=axes))
    return Dialect(closures)


def read_closing_frames(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures of onshape-to-robot: the links ``closing_NAME_1`` and ``closing_NAME_2``.

    The names say that two frames meet, not by which joint. Only beside a hinge, versions of the
    exporter add a second pair of frames further along its axis, ``closing_NAME_1_z`` and
    ``closing_NAME_2_z``. Without them the origins meet, which the exporter's manual has one
    enforce.
    """
    links, closures = [link.name for link in urdf.links], []
    for match in filter(None, map(CLOSING_FRAME.fullmatch, links)):
        name, side = match.groups()
        frames = (f"closing_{name}_1", f"closing_{name}_2")
        partner = frames[2 - int(side)]
        if partner not in links:
            raise RobotFileError(f"link {match[0]} closes a loop with {partner!r}: add it")
        if side == "2":
            continue
        if all(f"{frame}_z" in links for frame in frames):
            axial = ClosureDescription(type="hinge", name=name, frames=frames, axes=(Z, Z))
            closures.append(axial)
        else:
            closures.append(ClosureDescription(type="3d", name=name, frames=frames))
    return Dialect(closures)


def read_drake(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures of Drake's ball constraints, and its forces that no model has."""
    closures = []
    for k, element in enumerate(inner_tags(urdf.root, (BALL,)), start=1):
        name = f"{BALL}_{k}"
        with naming(f"<{BALL} name={name!r}>"):
            ball, points = etree.Element(BALL), list[pin.SE3]()
            for side, body, point in (("parent", "body_A", "p_AP"), ("child", "body_B", "p_BQ")):
                link, xyz = (said(element, f"{BALL}_{tag}") for tag in (body, point))
                if not (link and xyz):
                    raise RobotFileError(f"it needs {BALL}_{body} and _{point}")
                end = etree.SubElement(ball, side, link=link, xyz=xyz)
                points.append(pin.SE3(np.eye(3), np.array(numbers(end, "xyz", 3))))
            links = linked(urdf, ball)
            closures.append(mounted(model, "3d", name, links, (points[0], points[1])))
    pulling = inner_tags(urdf.root, PULLING)
    left_out = [LeftOut(f"<{str(tag.tag).rpartition('}')[2]}>") for tag in pulling]
    return Dialect(closures, left_out=left_out)
