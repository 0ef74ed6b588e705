"""Shapes of collision geometry as points whose convex hull they fill."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import RobotFileError
from loopid.loading.urdf.markup import Element, label, numbers, required
from loopid.regions import cube_directions

SIDES = 16  # of the prism that stands for a cylinder, its edges on the cylinder
PACKAGE = "package://"


def shape_points(collision: Element, file: Path) -> FloatArray:
    """Points (k, 3) in m of a ``<collision>`` tag, about its own origin.

    Parameters
    ----------
    file : Path
        The URDF, beside or above which meshes are looked for.

    Raises
    ------
    RobotFileError
        Where the shape is unknown or its sizes make no sense.
    FileNotFoundError
        Where a mesh is missing or cannot be read.
    """
    geometry = collision.find("geometry")
    shape = None if geometry is None else next((tag for tag in geometry if tag.tag in SHAPES), None)
    if shape is None:
        listed = ", ".join(SHAPES)
        raise RobotFileError(f"{label(collision)} has none of the geometries {listed}")
    return SHAPES[str(shape.tag)](shape, file)


def _box(shape: Element, _: Path) -> FloatArray:
    half = _sizes(shape, "size", 3) / 2
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    return np.asarray(corners * half, dtype=np.float64)


def _cylinder(shape: Element, _: Path) -> FloatArray:
    (radius,), (length,) = _sizes(shape, "radius"), _sizes(shape, "length")
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])
    ends = [np.column_stack([ring, np.full(SIDES, z)]) for z in (-length / 2, length / 2)]
    return np.concatenate(ends)


def _capsule(shape: Element, _: Path) -> FloatArray:
    (radius,), (length,) = _sizes(shape, "radius"), _sizes(shape, "length")
    ball, up = radius * cube_directions(), np.array([0.0, 0.0, length / 2])
    return np.concatenate([ball - up, ball + up])


def _sphere(shape: Element, _: Path) -> FloatArray:
    (radius,) = _sizes(shape, "radius")
    return np.asarray(radius * cube_directions(), dtype=np.float64)


def _mesh(shape: Element, file: Path) -> FloatArray:
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


def _sizes(shape: Element, attribute: str, count: int = 1) -> FloatArray:
    values = np.array(numbers(shape, attribute, count))
    if not (values > 0).all():
        raise RobotFileError(
            f"<{shape.tag!s}> {attribute} must be positive: {shape.get(attribute)}"
        )
    return values


SHAPES = {
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "capsule": _capsule,
    "mesh": _mesh,
}
