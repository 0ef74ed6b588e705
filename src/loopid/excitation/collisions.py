"""How near a robot's links come to each other, by the collision geometry of its URDF."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.errors import ModelWarning, warn
from loopid.loading import find_files, unread_mesh
from loopid.robot import Mechanism

# Pairs of links that stay this part of the robot's length apart in random poses are not looked at.
FAR = 0.1


class Collisions:
    """Distances between links, by coal: each piece of geometry stands for its convex hull.

    Neighbours in the tree or in a loop, and links that touch each other at the reference, are left
    out.

    Parameters
    ----------
    poses : FloatArray
        (N, nq), some of all over the workspace.
    """

    def __init__(self, mechanism: Mechanism, poses: FloatArray) -> None:
        self.mechanism = mechanism
        self.geometry = _geometry(mechanism)
        pieces = self.geometry.geometryObjects
        tied = _neighbours(mechanism)
        for i, first in enumerate(pieces):
            for j, second in enumerate(pieces[:i]):
                joints = frozenset((int(first.parentJoint), int(second.parentJoint)))
                if len(joints) == 2 and joints not in tied:
                    self.geometry.addCollisionPair(pin.CollisionPair(j, i))
        if self.pairs:
            touching = self._distances(mechanism.reference[None])[0] <= 0
            near = self._distances(poses).min(axis=0) < FAR * mechanism.length
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
    files = find_files(mechanism.path)
    if files.is_mjcf:
        return pin.GeometryModel()
    folders = [str(folder) for folder in files.tree.absolute().parents]
    try:
        if reason := unread_mesh(files.tree):  # Pinocchio waits for pipes
            raise ValueError(reason)
        geometry = pin.buildGeomFromUrdf(
            mechanism.model, str(files.tree), pin.GeometryType.COLLISION, package_dirs=folders
        )
    except (ValueError, RuntimeError) as error:
        warn(f"collisions of {mechanism.name} are not looked at: {error}", ModelWarning)
        return pin.GeometryModel()
    for piece in geometry.geometryObjects:
        if hasattr(piece.geometry, "buildConvexRepresentation"):
            piece.geometry.buildConvexRepresentation(False)
            piece.geometry = piece.geometry.convex
    return geometry


def _neighbours(mechanism: Mechanism) -> set[frozenset[int]]:
    """Pairs of joints whose links are next to each other, in the tree or through a closure."""
    model = mechanism.model
    found = {frozenset((k, int(model.parents[k]))) for k in range(1, model.njoints)}
    for closure in mechanism.closures:
        joints = [int(model.frames[frame].parentJoint) for frame in closure.frame_ids]
        found.add(frozenset(joints))
    return found
