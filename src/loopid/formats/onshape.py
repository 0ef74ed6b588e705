"""URDFs of onshape-to-robot: pairs of links that close a loop by their names."""

from __future__ import annotations

import re

import pinocchio as pin

from loopid.errors import RobotFileError
from loopid.loading.description import ClosureDescription
from loopid.loading.urdf import Dialect
from loopid.loading.urdf_tree import UrdfFile

CLOSING_FRAME = re.compile(r"closing_(.+)_([12])")
Z = (0.0, 0.0, 1.0)


def read_closing_frames(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Closures of the links ``closing_NAME_1`` and ``closing_NAME_2``.

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
