"""Regions of centres of mass: the collision geometry that a URDF gives the links.

The centre of mass of a body lies in the convex hull of what it is made of; collision geometry
stands for that. Links fixed to one joint are one body.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import DataError, ModelWarning, OptionError, RobotFileError, warn
from loopid.loading.description import find_files
from loopid.loading.urdf import (
    Element,
    label,
    naming,
    numbers,
    parse_xml,
    placement,
    required,
)
from loopid.regions import Region, cube_directions
from loopid.robot import Mechanism, in_groups

SHAPES = ("box", "cylinder", "sphere", "capsule", "mesh")
SIDES = 16  # of the prism that stands for a cylinder, its edges on the cylinder
PACKAGE = "package://"


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
    regions: dict[str, list[Region]] = {}
    names = in_groups(mechanism.links, mechanism.ties)
    with naming(files.tree):
        root = parse_xml(files.tree)
        links = {required(link, "name"): link for link in root.findall("link")}
        for body, name in zip(mechanism.bodies, names, strict=True):
            points = _points(mechanism.model, body.joint_id, links, files.tree)
            if points is None:
                continue
            try:
                region = Region.hull(points)
            except DataError as error:
                raise RobotFileError(f"collision geometry of link {body.link}: {error}") from error
            regions.setdefault(name, []).append(region)
    # A group of tied links has what all have.
    return {name: reduce(Region.intersection, found) for name, found in regions.items()}


def _points(
    model: pin.Model, joint: int, links: Mapping[str, Element], file: Path
) -> FloatArray | None:
    """Points (k, 3) of all collision geometry of a body; none where it has none, or unread."""
    found = []
    for frame in model.frames:
        if frame.parentJoint != joint or frame.type != pin.FrameType.BODY:
            continue
        link = links.get(frame.name)
        for collision in [] if link is None else link.findall("collision"):
            try:
                points = _shape_points(collision, file)
            except OSError as error:
                warn(f"{file}: no region for link {frame.name}: {error}", ModelWarning)
                return None
            place = frame.placement * placement(collision.find("origin"))
            found.append(points @ place.rotation.T + place.translation)
    return np.concatenate(found) if found else None


def _shape_points(collision: Element, file: Path) -> FloatArray:
    """Points (k, 3) in m about the origin of a ``<collision>``, whose convex hull it fills."""
    geometry = collision.find("geometry")
    shape = None if geometry is None else next((tag for tag in geometry if tag.tag in SHAPES), None)
    if shape is None:
        listed = ", ".join(SHAPES)
        raise RobotFileError(f"{label(collision)} has none of the geometries {listed}")
    if shape.tag == "mesh":
        return _mesh_points(shape, file)
    if shape.tag == "box":
        corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
        return np.asarray(corners * _sizes(shape, "size", 3), dtype=np.float64)
    (radius,) = _sizes(shape, "radius")
    if shape.tag == "sphere":
        return np.asarray(radius * cube_directions(), dtype=np.float64)
    (length,) = _sizes(shape, "length")
    up = np.array([0.0, 0.0, length / 2])
    end = radius * cube_directions()
    if shape.tag == "cylinder":
        angles = 2 * np.pi * np.arange(SIDES) / SIDES
        end = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(SIDES)])
    return np.concatenate([end - up, end + up])


def _sizes(shape: Element, attribute: str, count: int = 1) -> FloatArray:
    values = np.array(numbers(shape, attribute, count))
    if not (values > 0).all():
        raise RobotFileError(
            f"<{shape.tag!s}> {attribute} must be positive: {shape.get(attribute)}"
        )
    return values


def unread_mesh(file: Path) -> str:
    """Why a mesh of the collision geometry of a URDF is no file; nothing where all are."""
    try:
        for mesh in parse_xml(file).iterfind("link/collision/geometry/mesh"):
            _mesh_file(required(mesh, "filename"), file)
    except (FileNotFoundError, RobotFileError) as error:
        return str(error)
    return ""


def _mesh_points(shape: Element, file: Path) -> FloatArray:
    import trimesh  # here, as it takes a while to import

    path = _mesh_file(required(shape, "filename"), file)
    scale = np.array(numbers(shape, "scale", 3, "1 1 1"))
    try:
        mesh: Any = trimesh.load(path, force="mesh")
    except Exception as error:  # whatever its readers of many formats raise
        raise FileNotFoundError(f"mesh {path} cannot be read: {error}") from error
    if not len(mesh.vertices):
        raise FileNotFoundError(f"mesh {path} cannot be read: it holds no points")
    return np.asarray(mesh.vertices * scale, dtype=np.float64)


def _mesh_file(name: str, file: Path) -> Path:
    """A mesh beside the URDF, or of a package in one of the folders above it."""
    if not name.startswith(PACKAGE):
        found = file.parent / name.removeprefix("file://")
        if found.is_file():
            return found
        raise FileNotFoundError(f"there is no mesh {found}")
    parts = Path(name.removeprefix(PACKAGE)).parts
    for folder in file.resolve().parents:
        for candidate in (folder.joinpath(*parts), folder.joinpath(*parts[1:])):
            if candidate.is_file():
                return candidate
    raise FileNotFoundError(f"mesh {name} is in no folder above it")
