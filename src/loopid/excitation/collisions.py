"""Distances between links, by coal: each piece of geometry stands for its convex hull."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from loopid.arguments import FloatArray
from loopid.errors import ModelWarning, warn
from loopid.loading.files import find_files
from loopid.robot.mechanism import Mechanism

# Pairs of links that stay this part of the robot's length apart in random poses are not looked at.
FAR = 0.1


class Collisions:
    """Distances between the links that may touch each other.

    Neighbours in the tree or in a loop, and links that touch each other at the reference, are left
    out.

    Parameters
    ----------
    poses : FloatArray
        (N, nq), some of all over the workspace.
    """

    def __init__(self, mechanism: Mechanism, poses: FloatArray) -> None:
        self.mechanism, self.far = mechanism, FAR * mechanism.length
        self.geometry = _geometry(mechanism)
        pieces, tied = self.geometry.geometryObjects, _neighbours(mechanism)
        for i, first in enumerate(pieces):
            for j, second in enumerate(pieces[:i]):
                joints = frozenset((int(first.parentJoint), int(second.parentJoint)))
                if len(joints) == 2 and joints not in tied:
                    self.geometry.addCollisionPair(pin.CollisionPair(j, i))
        if self.pairs:
            touching = self._distances(mechanism.reference[None])[0] <= 0
            near = self._distances(poses).min(axis=0) < self.far
            pairs = list(self.geometry.collisionPairs)
            self.geometry.removeAllCollisionPairs()
            for pair, wanted in zip(pairs, near & ~touching, strict=True):
                if wanted:
                    self.geometry.addCollisionPair(pair)

    @property
    def pairs(self) -> int:
        """How many pairs of links may touch."""
        return len(self.geometry.collisionPairs)

    def least(self, q: FloatArray) -> FloatArray:
        """Distance (N,) in m between the two links that are nearest; negative inside each other."""
        return np.asarray(self._distances(q).min(axis=1), dtype=np.float64)

    def _distances(self, q: FloatArray) -> FloatArray:
        model = self.mechanism.model
        data, geometry = model.createData(), self.geometry.createData()
        found = np.empty((len(q), self.pairs))
        for k, configuration in enumerate(q):
            pin.computeDistances(model, data, self.geometry, geometry, configuration)
            found[k] = [result.min_distance for result in geometry.distanceResults]
        return found


def _geometry(mechanism: Mechanism) -> pin.GeometryModel:
    """Collision geometry of the URDF, as convex hulls; none where there is none, or no mesh."""
    tree = find_files(mechanism.path).tree
    if tree.suffix != ".urdf":
        return pin.GeometryModel()
    folders = [str(folder) for folder in tree.absolute().parents]
    try:
        geometry = pin.buildGeomFromUrdf(
            mechanism.model, str(tree), pin.GeometryType.COLLISION, package_dirs=folders
        )
    except (ValueError, RuntimeError) as error:
        warn(f"collisions of {mechanism.name} are not looked at: {error}", ModelWarning)
        return pin.GeometryModel()
    for piece in geometry.geometryObjects:
        if isinstance(piece.geometry, coal.BVHModelBase):
            piece.geometry = convex_hull(piece.geometry)
    return geometry


def convex_hull(mesh: coal.BVHModelBase) -> Any:
    """The convex hull of a mesh.

    ``buildConvexRepresentation`` of coal 3 takes the mesh as it is for convex: it needs the hull.
    """
    points = np.array([mesh.vertex(k) for k in range(mesh.num_vertices)])
    try:
        hull = ConvexHull(points)
    except QhullError:  # flat
        mesh.buildConvexRepresentation(False)
        return mesh.convex
    corners, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    corners.extend([points[k] for k in hull.vertices])
    number = {int(k): n for n, k in enumerate(hull.vertices)}
    for triangle in hull.simplices.tolist():
        triangles.append(coal.Triangle(*(number[k] for k in triangle)))
    return coal.Convex(corners, triangles)


def _neighbours(mechanism: Mechanism) -> set[frozenset[int]]:
    """Pairs of joints whose links are next to each other, in the tree or through a closure."""
    model = mechanism.model
    found = {frozenset((k, int(model.parents[k]))) for k in range(1, model.njoints)}
    for closure in mechanism.closures:
        found.add(frozenset(int(model.frames[k].parentJoint) for k in closure.frame_ids))
    return found
