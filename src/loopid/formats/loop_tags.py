"""Tags with a type that close a loop between two links: URDF+, Isaac Sim, urdfdom's proposal."""

from __future__ import annotations

import pinocchio as pin

from loopid.errors import naming
from loopid.loading.urdf import PARENT_CHILD, Dialect, closure_of, linked
from loopid.loading.urdf_tree import UrdfFile
from loopid.loading.xml_elements import label, named_tags, placement

# Tags that name the links, where the place in a link stands, with {} for its side, and axes as of
# ``closure_of``.
LOOP_TAGS: dict[str, tuple[tuple[str, str], str, tuple[str, str] | str]] = {
    "loop": (("predecessor", "successor"), "{}/origin", "axis"),  # URDF+ [Chignoli2024]
    "loop_joint": (("link1", "link2"), "{}", "axis"),  # Isaac Sim
    "constraint": (PARENT_CHILD, "{}_origin", ("parent_axis", "child_axis")),  # urdfdom's 264
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
