"""Tags with a type that close a loop between two links: URDF+, Isaac Sim, urdfdom's proposal."""

from __future__ import annotations

from typing import NamedTuple

import pinocchio as pin

from loopid.errors import naming
from loopid.loading.urdf import PARENT_CHILD, Dialect, closure_of, linked
from loopid.loading.urdf_tree import UrdfFile
from loopid.loading.xml_elements import label, named_tags, placement


class LoopTag(NamedTuple):
    """What a tag calls its parts."""

    sides: tuple[str, str]  # tags that name the links
    origin: str  # where the place in a link stands, with {} for its side
    axes: tuple[str, str] | str  # as of ``closure_of``


LOOP_TAGS = {
    "loop": LoopTag(("predecessor", "successor"), "{}/origin", "axis"),  # URDF+ [Chignoli2024]
    "loop_joint": LoopTag(("link1", "link2"), "{}", "axis"),  # Isaac Sim
    # urdfdom, pull request 264
    "constraint": LoopTag(PARENT_CHILD, "{}_origin", ("parent_axis", "child_axis")),
}


def read_loop_tags(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures with a placement in either link."""
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
