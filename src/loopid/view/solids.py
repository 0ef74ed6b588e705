"""What robot files draw of their links: triangles in the frames of the joints that carry them."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
import trimesh
from lxml import etree
from trimesh import creation

from loopid.arguments import FloatArray
from loopid.errors import ModelWarning, one_line, warn
from loopid.loading.files import files_of
from loopid.loading.urdf_tree import read_urdf_file
from loopid.robot.robot import Robot

Color: TypeAlias = tuple[int, int, int]
Solid: TypeAlias = tuple[int, Color, trimesh.Trimesh]  # joint by its index, triangles in its frame
SHOWN_GROUPS = 3  # of MuJoCo's geometry: its own viewer shows these at first, then collisions
SECTIONS = 12  # of what is round: without a graphics card, triangles take long


def read_solids(robot: Robot) -> list[Solid]:
    """What a robot's URDF or MJCF draws, in one piece a joint and colour."""
    if robot.path is None:
        return []
    tree = files_of(robot).tree
    read = {".urdf": _of_urdf, ".xml": _of_mjcf, ".mjcf": _of_mjcf}.get(tree.suffix)
    pieces = dict[tuple[int, Color], list[trimesh.Trimesh]]()
    for joint, color, mesh in read(robot, tree) if read else ():
        pieces.setdefault((joint, color), []).append(mesh)
    return [(*key, trimesh.util.concatenate(meshes)) for key, meshes in pieces.items()]


def _of_urdf(robot: Robot, tree: Path) -> Iterator[Solid]:
    from yourdfpy import URDF

    urdf = read_urdf_file(tree)
    for joint in urdf.second:  # yourdfpy knows trees alone
        urdf.root.remove(joint)
    try:
        scene = URDF.load(BytesIO(etree.tostring(urdf.root)), mesh_dir=str(tree.parent)).scene
    except Exception as error:  # whatever is wrong with a shape or its file
        warn(f"{tree}: shapes of links are not drawn: {one_line(str(error))}", ModelWarning)
        return
    for node in scene.graph.nodes_geometry:
        link = scene.graph.transforms.parents[node]
        place, name = scene.graph.get(node, frame_from=link)
        frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
        mesh, look = scene.geometry[name].copy(), scene.geometry[name].visual
        color = (look.material if look.kind == "texture" else look).main_color
        mesh.apply_transform(frame.placement.homogeneous @ place)
        yield frame.parentJoint, _color(color / 255), mesh


def _of_mjcf(robot: Robot, tree: Path) -> Iterator[Solid]:
    from mujoco import mjtGeom

    from loopid.formats.mjcf_scene import Scene, compile_mjcf

    compiled, _ = compile_mjcf(tree)
    links = Scene(tree, compiled).bodies
    for k in np.flatnonzero(compiled.geom_group < SHOWN_GROUPS):
        kind, size = mjtGeom(int(compiled.geom_type[k])), compiled.geom_size[k]
        scale, link = np.ones(3), links[compiled.geom_bodyid[k]]
        if kind == mjtGeom.mjGEOM_BOX:
            mesh = creation.box(2 * size)
        elif kind in (mjtGeom.mjGEOM_SPHERE, mjtGeom.mjGEOM_ELLIPSOID):
            mesh, scale = creation.icosphere(1), size if size[1] else size[[0, 0, 0]]
        elif kind == mjtGeom.mjGEOM_CYLINDER:
            mesh = creation.cylinder(size[0], 2 * size[1], sections=SECTIONS)
        elif kind == mjtGeom.mjGEOM_CAPSULE:
            mesh = creation.capsule(2 * size[1], size[0], count=[SECTIONS, SECTIONS])
            mesh.vertices -= mesh.bounds.mean(axis=0)  # older ones begin at their lower end
        elif kind == mjtGeom.mjGEOM_MESH:
            mesh = _mesh(compiled, int(compiled.geom_dataid[k]))
        else:  # planes, fields of heights
            continue
        frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
        turn = pin.Quaternion(*compiled.geom_quat[k]).toRotationMatrix()
        place = frame.placement * pin.SE3(turn, compiled.geom_pos[k])
        material = compiled.geom_matid[k]
        look = compiled.mat_rgba[material] if material >= 0 else compiled.geom_rgba[k]
        mesh.apply_transform(place.homogeneous @ np.diag([*scale, 1.0]))
        yield frame.parentJoint, _color(look), mesh


def _mesh(compiled: Any, k: int) -> trimesh.Trimesh:
    first, face = compiled.mesh_vertadr[k], compiled.mesh_faceadr[k]
    corners = compiled.mesh_vert[first : first + compiled.mesh_vertnum[k]]
    faces = compiled.mesh_face[face : face + compiled.mesh_facenum[k]]
    return trimesh.Trimesh(corners, faces, process=False)


def _color(part: FloatArray) -> Color:
    red, green, blue = (int(255 * x) for x in part[:3])
    return red, green, blue
