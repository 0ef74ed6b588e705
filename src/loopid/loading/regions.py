"""Regions of centres of mass: the collision geometry that a URDF gives the links.

The centre of mass of a body lies in the convex hull of what it is made of; collision geometry
stands for that. Links fixed to one joint are one body.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import reduce
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import DataError, ModelWarning, OptionError, RobotFileError
from loopid.loading.shapes import shape_points
from loopid.loading.tree_file import find_files
from loopid.loading.urdf.markup import Element, naming, numbers, parse_xml, required
from loopid.robot import Mechanism
from loopid.robot import in_groups
from loopid.regions import Region


@checked
def collision_regions(mechanism: Mechanism) -> dict[str, Region]:
    """Where the centres of mass of a robot's bodies may lie, by its collision geometry.

    Parameters
    ----------
    mechanism : Mechanism
        Loaded from a URDF.

    Returns
    -------
    dict of str to Region
        From names of bodies, or of groups of links that are tied, to the hull of all their
        collision geometry in the frame of the link; bodies without any are left out.

    Raises
    ------
    RobotFileError, OptionError
        Where the geometry makes no sense, or the robot is no URDF.

    Warns
    -----
    ModelWarning
        Of bodies that are left out because a mesh of theirs cannot be read.
    """
    files = find_files(mechanism.path)
    if files.is_mjcf:
        raise OptionError(f"{files.tree}: collision geometry is read from a URDF only")
    with naming(files.tree):
        root = parse_xml(files.tree)
        links = {required(link, "name"): link for link in root.findall("link")}
        points = {
            body.link: _points(mechanism, body.joint_id, links, files.tree)
            for body in mechanism.bodies
        }
    regions = {
        link: _region(files.tree, link, found)
        for link, found in points.items()
        if found is not None
    }
    return _by_name(mechanism, regions)


def _points(
    mechanism: Mechanism, joint: int, links: Mapping[str, Element], file: Path
) -> FloatArray | None:
    """Points (k, 3) of all collision geometry of a body; none where it has none, or unread."""
    found = []
    for frame in mechanism.model.frames:
        if frame.parentJoint == joint and frame.type == pin.FrameType.BODY and frame.name in links:
            for collision in links[frame.name].findall("collision"):
                try:
                    points = shape_points(collision, file)
                except OSError as error:
                    warnings.warn(
                        f"{file}: no region for link {frame.name}: {error}",
                        ModelWarning,
                        stacklevel=4,
                    )
                    return None
                found.append(_placed(frame.placement * _origin(collision), points))
    return np.concatenate(found) if found else None


def _origin(collision: Element) -> pin.SE3:
    origin = collision.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (np.array(numbers(origin, key, 3, "0 0 0")) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _placed(placement: pin.SE3, points: FloatArray) -> FloatArray:
    return np.asarray(points @ placement.rotation.T + placement.translation, dtype=np.float64)


def _region(file: Path, link: str, points: FloatArray) -> Region:
    try:
        return Region.hull(points)
    except DataError as error:
        raise RobotFileError(f"{file}: collision geometry of link {link}: {error}") from error


def _by_name(mechanism: Mechanism, regions: Mapping[str, Region]) -> dict[str, Region]:
    """Regions under the names of the parameters: a group of tied links has what all have."""
    named: dict[str, list[Region]] = {}
    for link, name in zip(mechanism.links, in_groups(mechanism.links, mechanism.ties), strict=True):
        if link in regions:
            named.setdefault(name, []).append(regions[link])
    return {name: reduce(Region.intersection, found) for name, found in named.items()}
