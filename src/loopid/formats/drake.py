"""Tags of Drake: ball constraints and bushings."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.errors import RobotFileError, naming
from loopid.loading.urdf import Dialect, linked, mounted
from loopid.loading.urdf_tree import UrdfFile
from loopid.loading.xml_elements import inner_tags, numbers, said
from loopid.robot.robot import LeftOut

BALL = "ball_constraint"
PULLING = ("linear_bushing_rpy", "linear_spring_damper")


def read_drake(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures of ball constraints, and forces that no model has."""
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
