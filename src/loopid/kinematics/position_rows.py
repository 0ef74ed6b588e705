"""Rows about the origins of two frames, zero where the loop is closed.

With d = p_b - p_a and R_a the rotation of frame a:

- ``Point``: r = p_a - p_b along the fixed axes (m);
- ``Slide``: r = (R_a k)ᵀ d for some directions k (m);
- ``Distance``: r = (dᵀd - l²) / 2l for a rod of length l (m).
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.pairs import PairMotion, PairPose, Rows, dot


class Point(Rows):
    """The origins coincide."""

    count = 3

    def residual(self, pose: PairPose) -> FloatArray:
        return -pose.distance

    def jacobian(self, pose: PairPose) -> FloatArray:
        return pose.jacobian_a[:, :3] - pose.jacobian_b[:, :3]

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        return motion.acceleration_a[:, :3] - motion.acceleration_b[:, :3]


class Slide(Rows):
    """The origin of b stays where it is seen from a along some directions (k, 3)."""

    def __init__(self, directions: FloatArray) -> None:
        self.directions = directions
        self.count = len(directions)

    def residual(self, pose: PairPose) -> FloatArray:
        return dot(self._carried(pose), pose.distance[:, None])

    def jacobian(self, pose: PairPose) -> FloatArray:
        k, d = self._carried(pose), pose.distance[:, None]
        moved = k @ (pose.jacobian_b[:, :3] - pose.jacobian_a[:, :3])
        return moved + np.cross(k, d) @ pose.jacobian_a[:, 3:]

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        k, d = self._carried(pose), pose.distance[:, None]
        rate = (motion.twist_b - motion.twist_a)[:, None, :3]
        turn = motion.twist_a[:, None, 3:]
        acceleration = (motion.acceleration_b - motion.acceleration_a)[:, None, :3]
        k_rate = np.cross(turn, k)
        k_drift = np.cross(motion.acceleration_a[:, None, 3:], k) + np.cross(turn, k_rate)
        return dot(k_drift, d) + 2.0 * dot(k_rate, rate) + dot(k, acceleration)

    def _carried(self, pose: PairPose) -> FloatArray:
        carried: FloatArray = np.einsum("nij,kj->nki", pose.rotation_a, self.directions)
        return carried


class Distance(Rows):
    """The origins keep their distance."""

    count = 1

    def __init__(self, length: float) -> None:
        self.length = length

    def residual(self, pose: PairPose) -> FloatArray:
        square = dot(pose.distance, pose.distance)
        return np.asarray((square - self.length**2)[:, None] / (2.0 * self.length))

    def jacobian(self, pose: PairPose) -> FloatArray:
        rate = pose.jacobian_b[:, :3] - pose.jacobian_a[:, :3]
        return np.asarray(pose.distance[:, None] @ rate / self.length, dtype=np.float64)

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        rate = (motion.twist_b - motion.twist_a)[:, :3]
        acceleration = (motion.acceleration_b - motion.acceleration_a)[:, :3]
        second = dot(rate, rate) + dot(pose.distance, acceleration)
        return np.asarray(second[:, None] / self.length)
