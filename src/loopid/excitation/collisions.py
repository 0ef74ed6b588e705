"""Distances between links, by coal: each piece of geometry stands for its convex hull."""

from __future__ import annotations

from collections import Counter
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from lxml import etree
from scipy.spatial import ConvexHull, QhullError

from loopid.arguments import FloatArray
from loopid.errors import ModelWarning, warn
from loopid.loading.files import files_of
from loopid.loading.urdf_tree import urdf_root
from loopid.robot.robot import Robot, shortened

# Pairs of links that stay this part of the robot's length apart in random poses are not looked at.
FAR = 0.1


class Collisions:
    """Distances between the links that may touch each other.

    Neighbours in the tree or in a loop, and links that touch each other at the reference, are left
    out. So are those far from each other in poses (N, nq) of all over the workspace.
    """

    def __init__(self, robot: Robot, poses: FloatArray) -> None:
        self.robot, self.far = robot, FAR * robot.length
        self.geometry = _geometry(robot)
        pieces, model = self.geometry.geometryObjects, robot.model
        tied = {frozenset((k, int(model.parents[k]))) for k in range(1, model.njoints)}
        for closure in robot.closures:
            tied.add(frozenset(int(model.frames[k].parentJoint) for k in closure.frame_ids))
        for i, first in enumerate(pieces):
            for j, second in enumerate(pieces[:i]):
                joints = frozenset((int(first.parentJoint), int(second.parentJoint)))
                if len(joints) == 2 and joints not in tied:
                    self.geometry.addCollisionPair(pin.CollisionPair(j, i))
        if self.pairs:
            touching = self._distances(robot.reference[None])[0] <= 0
            near = self._distances(poses).min(axis=0) < self.far
            pairs = list(self.geometry.collisionPairs)
            self.geometry.removeAllCollisionPairs()
            for pair, wanted in zip(pairs, near & ~touching, strict=True):
                if wanted:
                    self.geometry.addCollisionPair(pair)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Links that may touch each other."""
        frames = self.robot.model.frames
        links = [frames[piece.parentFrame].name for piece in self.geometry.geometryObjects]
        pairs = self.geometry.collisionPairs
        return tuple(dict.fromkeys((links[pair.first], links[pair.second]) for pair in pairs))

    def least(self, q: FloatArray) -> FloatArray:
        """Distance (N,) in m between the two links that are nearest; negative inside each other."""
        return np.asarray(self._distances(q).min(axis=1), dtype=np.float64)

    def _distances(self, q: FloatArray) -> FloatArray:
        model = self.robot.model
        data, geometry = model.createData(), self.geometry.createData()
        found = np.empty((len(q), len(self.geometry.collisionPairs)))
        for k, configuration in enumerate(q):
            pin.computeDistances(model, data, self.geometry, geometry, configuration)
            found[k] = [result.min_distance for result in geometry.distanceResults]
        return found


def _geometry(robot: Robot) -> pin.GeometryModel:
    """Collision geometry of the URDF, as convex hulls; none where there is none, or no mesh."""
    tree = None if robot.path is None else files_of(robot).tree
    if tree is None or tree.suffix != ".urdf":
        return pin.GeometryModel()
    root, folders = urdf_root(tree), [str(folder) for folder in tree.absolute().parents]
    given = Counter[str]()
    for link in root.findall("link"):
        for tag in link.findall("visual"):
            link.remove(tag)
        for tag in link.findall("collision"):
            given[link.get("name", "")] += 1
            sizes = tag.xpath("geometry/*/@size | geometry/*/@radius | geometry/*/@length")
            if any(each.startswith("-") for each in " ".join(sizes).split()):  # else it counts
                link.remove(tag)
    urdf = etree.tostring(root, encoding="unicode")
    try:
        geometry = pin.buildGeomFromUrdfString(
            robot.model, urdf, pin.GeometryType.COLLISION, package_dirs=folders
        )
    except (ValueError, RuntimeError) as error:
        warn(f"collisions of {robot.name} are not looked at: {error}", ModelWarning)
        return pin.GeometryModel()
    links = (robot.model.frames[piece.parentFrame].name for piece in geometry.geometryObjects)
    if unread := given - Counter(links):
        what = f"collision geometry of {shortened([*unread])} cannot be read, or has a size below 0"
        warn(f"{what}: it is left out", ModelWarning)
    for piece in geometry.geometryObjects:
        if isinstance(piece.geometry, coal.BVHModelBase):
            piece.geometry = convex_hull(piece.geometry)
    return geometry


def convex_hull(mesh: coal.BVHModelBase) -> Any:
    """The convex hull, which ``buildConvexRepresentation`` of coal 3 takes a mesh to be."""
    points = np.array([mesh.vertex(k) for k in range(mesh.num_vertices)])
    try:
        hull = ConvexHull(points)
    except QhullError:  # flat: points are moved by round-off
        points = np.resize(points, (max(len(points), 4), 3))
        hull = ConvexHull(points, qhull_options="QJ")
    corners, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    corners.extend([points[k] for k in hull.vertices])
    number = {int(k): n for n, k in enumerate(hull.vertices)}
    for triangle in hull.simplices.tolist():
        triangles.append(coal.Triangle(*(number[k] for k in triangle)))
    return coal.Convex(corners, triangles)
