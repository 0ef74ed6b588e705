"""Rows about the orientations of two frames, zero where the loop is closed.

With R the rotation of a frame and ω = ω_b - ω_a:

- ``Turn``: r = 2 vec(h), h the unit quaternion of R_aᵀ R_b (rad for small angles). With
  w = scalar(h) >= 0, e = vec(h) and ω in frame a, dr/dt = (w I - [e]) ω, [e] being the
  cross-product matrix of e. Unlike the rotation logarithm it has a simple second derivative, and
  its Jacobian is regular up to half a turn;
- ``Square``: r = (R_a i)ᵀ (R_b j), two axes at right angles;
- ``Align``: r = 2 s / (1 + c), with c the cosine between two axes and s the components of the
  second one across the first: 2 tan(θ/2), so axes that point against each other are no solution.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.pairs import PairMotion, PairPose, Rows, apply, dot
from loopid.mechanism.closure import Axis


class Turn(Rows):
    """The axes coincide."""

    count = 3
    angular = True

    def residual(self, pose: PairPose) -> FloatArray:
        return 2.0 * pose.quaternion[0]

    def jacobian(self, pose: PairPose) -> FloatArray:
        vector, scalar = pose.quaternion
        turn = pose.jacobian_b[:, 3:] - pose.jacobian_a[:, 3:]
        return _rate_matrix(vector, scalar) @ pose.rotation_a.transpose(0, 2, 1) @ turn

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        """M dω/dt + (dM/dt) ω with M = w I - [e]."""
        vector, scalar = pose.quaternion
        to_a = pose.rotation_a.transpose(0, 2, 1)
        turn_a, turn_b = motion.twist_a[:, 3:], motion.twist_b[:, 3:]
        omega = apply(to_a, turn_b - turn_a)
        # R_aᵀ turns with frame a, which adds -ω_a x (ω_b - ω_a) = -ω_a x ω_b.
        rate = (motion.acceleration_b - motion.acceleration_a)[:, 3:] - np.cross(turn_a, turn_b)
        matrix = _rate_matrix(vector, scalar)
        vector_rate = 0.5 * apply(matrix, omega)
        scalar_rate = -0.5 * dot(vector, omega)
        return apply(matrix, apply(to_a, rate)) + apply(
            _rate_matrix(vector_rate, scalar_rate), omega
        )


class Square(Rows):
    """Axes i of frame a and j of frame b are at right angles."""

    count = 1
    angular = True

    def __init__(self, axis_a: Axis, axis_b: Axis) -> None:
        self.cosine = _Cosines(np.array([axis_a]), axis_b)

    def residual(self, pose: PairPose) -> FloatArray:
        return self.cosine.value(pose)

    def jacobian(self, pose: PairPose) -> FloatArray:
        return self.cosine.jacobian(pose)

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        return self.cosine.drift(pose, motion)


class Align(Rows):
    """Axes of the two frames point the same way."""

    count = 2
    angular = True

    def __init__(self, axis_a: Axis, axis_b: Axis) -> None:
        self.along = _Cosines(np.array([axis_a]), axis_b)
        self.across = _Cosines(across(axis_a), axis_b)

    def residual(self, pose: PairPose) -> FloatArray:
        return 2.0 * self.across.value(pose) / self._denominator(pose)

    def jacobian(self, pose: PairPose) -> FloatArray:
        s, scale = self.across.value(pose), self._denominator(pose)
        both = self.across.jacobian(pose) * scale[:, :, None]
        return 2.0 * (both - s[:, :, None] * self.along.jacobian(pose)) / scale[:, :, None] ** 2

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        """Second derivative of 2 s / (1 + c) by the quotient rule."""
        s, scale = self.across.value(pose), self._denominator(pose)
        s_rate, c_rate = self.across.rate(pose, motion), self.along.rate(pose, motion)
        s_drift, c_drift = self.across.drift(pose, motion), self.along.drift(pose, motion)
        first = (s_drift * scale - s * c_drift) / scale**2
        return 2.0 * (first - 2.0 * c_rate * (s_rate * scale - s * c_rate) / scale**3)

    def _denominator(self, pose: PairPose) -> FloatArray:
        return np.maximum(1.0 + self.along.value(pose), 1e-12)


class _Cosines:
    """Cosines (R_a i)ᵀ (R_b j) for axes i (k, 3) of frame a and one axis j of frame b."""

    def __init__(self, axes_a: FloatArray, axis_b: Axis) -> None:
        self.axes_a, self.axis_b = axes_a, np.array(axis_b)

    def value(self, pose: PairPose) -> FloatArray:
        return dot(*self._carried(pose))

    def jacobian(self, pose: PairPose) -> FloatArray:
        i, j = self._carried(pose)
        return np.cross(i, j) @ (pose.jacobian_a[:, 3:] - pose.jacobian_b[:, 3:])

    def rate(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        i, j = self._carried(pose)
        turn = (motion.twist_a - motion.twist_b)[:, None, 3:]
        return dot(np.cross(i, j), turn)

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        i, j = self._carried(pose)
        turn_a, turn_b = motion.twist_a[:, None, 3:], motion.twist_b[:, None, 3:]
        relative = (motion.acceleration_a - motion.acceleration_b)[:, None, 3:]
        normal_rate = np.cross(np.cross(turn_a, i), j) + np.cross(i, np.cross(turn_b, j))
        return dot(np.cross(i, j), relative) + dot(normal_rate, turn_a - turn_b)

    def _carried(self, pose: PairPose) -> tuple[FloatArray, FloatArray]:
        i = np.einsum("nij,kj->nki", pose.rotation_a, self.axes_a)
        return i, (pose.rotation_b @ self.axis_b)[:, None]


def across(axis: Axis) -> FloatArray:
    """Two unit vectors (2, 3) that form a right-handed frame with an axis."""
    direction = np.asarray(axis, dtype=np.float64)
    # The coordinate axis most across it; for z this gives x and y.
    helper = np.eye(3)[int(np.abs(direction).argmin())]
    first = helper - direction * (helper @ direction)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def _rate_matrix(vector: FloatArray, scalar: FloatArray) -> FloatArray:
    """The matrices w I - [e]; shape (N, 3, 3)."""
    x, y, z = vector.T
    rows = [[scalar, z, -y], [-z, scalar, x], [y, -x, scalar]]
    return np.array(rows).transpose(2, 0, 1)
