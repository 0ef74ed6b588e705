"""``<loop_joint>`` of Isaac Sim's URDF."""

from __future__ import annotations

import pinocchio as pin

from loopid.errors import naming
from loopid.loading.urdf import Dialect, closure_of, linked
from loopid.loading.urdf_tree import UrdfFile
from loopid.loading.xml_elements import label, named_tags, placement

ENDS = ("link1", "link2")


def read_loop_joints(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures with a placement in either link."""
    closures = []
    for element in named_tags(urdf.root, "loop_joint"):
        for repeated in element.findall("link1")[1:]:
            repeated.tag = "link2"  # the manual writes <link1> twice
        with naming(label(element)):
            first, second = (placement(element.find(side)) for side in ENDS)
            links, places = linked(urdf, element, ENDS), (first, second)
            closures.append(closure_of(model, element, links, places, sides=ENDS, axes="axis"))
    return Dialect(closures)
