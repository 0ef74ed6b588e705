"""``<constraint>`` of URDF as proposed for urdfdom (pull request 264)."""

from __future__ import annotations

import pinocchio as pin

from loopid.errors import naming
from loopid.loading.urdf import PARENT_CHILD, Dialect, closure_of, linked
from loopid.loading.urdf_tree import UrdfFile
from loopid.loading.xml_elements import label, named_tags, placement


def read_constraints(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures with an origin, and where they need one an axis, in either link."""
    closures = []
    for element in named_tags(urdf.root, "constraint"):
        with naming(label(element)):
            first, second = (placement(element.find(f"{side}_origin")) for side in PARENT_CHILD)
            links, axes = linked(urdf, element), ("parent_axis", "child_axis")
            closures.append(closure_of(model, element, links, (first, second), axes=axes))
    return Dialect(closures)
