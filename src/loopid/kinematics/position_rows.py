"""Rows about the origins of two frames, zero where the loop is closed.

With d = p_b - p_a and R_a the rotation of frame a:

- ``Point``: r = p_a - p_b along the fixed axes (m);
- ``Slide``: r = (R_a k)ᵀ d for some directions k (m);
- ``Distance``: r = (dᵀd - l²) / 2l for a rod of length l (m).
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.pairs import PairMotion, PairPose, Rows
from loopid.kinematics.vectors import along, cross, dot


class Point(Rows):
    """The origins coincide."""

    count = 3

    def residual(self, pose: PairPose) -> FloatArray:
        return -pose.distance

    def jacobian(self, pose: PairPose) -> FloatArray:
        return -pose.shift

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        return -motion.acceleration


class Slide(Rows):
    """The origin of b stays where it is seen from a along some directions (k, 3)."""

    def __init__(self, directions: FloatArray) -> None:
        self.directions = directions
        self.count = len(directions)

    def residual(self, pose: PairPose) -> FloatArray:
        return dot(self._carried(pose), pose.distance[:, None])

    def jacobian(self, pose: PairPose) -> FloatArray:
        k = self._carried(pose)
        moved = along(k, pose.shift)
        return moved + along(cross(k, pose.distance[:, None]), pose.turn_a)

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        k, turn = self._carried(pose), motion.turn_a[:, None]
        k_rate = cross(turn, k)
        k_drift = cross(motion.turning_a[:, None], k) + cross(turn, k_rate)
        second = dot(k_drift, pose.distance[:, None]) + dot(k, motion.acceleration[:, None])
        return second + 2.0 * dot(k_rate, motion.rate[:, None])

    def _carried(self, pose: PairPose) -> FloatArray:
        carried: FloatArray = np.einsum("ijn,kj->ikn", pose.rotation_a, self.directions)
        return carried


class Distance(Rows):
    """The origins keep their distance."""

    count = 1

    def __init__(self, length: float) -> None:
        self.length = length

    def residual(self, pose: PairPose) -> FloatArray:
        square = dot(pose.distance, pose.distance)
        return np.asarray((square - self.length**2)[None] / (2.0 * self.length))

    def jacobian(self, pose: PairPose) -> FloatArray:
        return along(pose.distance[:, None], pose.shift) / self.length

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        second = dot(motion.rate, motion.rate) + dot(pose.distance, motion.acceleration)
        return np.asarray(second[None] / self.length)
