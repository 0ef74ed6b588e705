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
from loopid.kinematics.pairs import PairMotion, PairPose, Rows
from loopid.kinematics.vectors import along, cross, dot, rotated, rotated_back
from loopid.robot.closure import Axis


class Turn(Rows):
    """The axes coincide."""

    count = 3
    angular = True

    def residual(self, pose: PairPose) -> FloatArray:
        return 2.0 * pose.quaternion[0]

    def jacobian(self, pose: PairPose) -> FloatArray:
        in_a = rotated_back(pose.rotation_a[:, :, None], pose.turn)
        return rotated(_rate_matrix(*pose.quaternion)[:, :, None], in_a)

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        """M dω/dt + (dM/dt) ω with M = w I - [e]."""
        vector, scalar = pose.quaternion
        omega = rotated_back(pose.rotation_a, motion.turn_b - motion.turn_a)
        # R_aᵀ turns with frame a, which adds -ω_a x (ω_b - ω_a) = -ω_a x ω_b.
        rate = motion.turning_b - motion.turning_a - cross(motion.turn_a, motion.turn_b)
        matrix = _rate_matrix(vector, scalar)
        changing = _rate_matrix(0.5 * rotated(matrix, omega), -0.5 * dot(vector, omega))
        return rotated(matrix, rotated_back(pose.rotation_a, rate)) + rotated(changing, omega)


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
        both = self.across.jacobian(pose) * scale
        return 2.0 * (both - s[:, None] * self.along.jacobian(pose)) / scale**2

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
        return along(-cross(*self._carried(pose)), pose.turn)

    def rate(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        turn = (motion.turn_a - motion.turn_b)[:, None]
        return dot(cross(*self._carried(pose)), turn)

    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        i, j = self._carried(pose)
        turn_a, turn_b = motion.turn_a[:, None], motion.turn_b[:, None]
        relative = (motion.turning_a - motion.turning_b)[:, None]
        normal_rate = cross(cross(turn_a, i), j) + cross(i, cross(turn_b, j))
        return dot(cross(i, j), relative) + dot(normal_rate, turn_a - turn_b)

    def _carried(self, pose: PairPose) -> tuple[FloatArray, FloatArray]:
        i = np.einsum("ijn,kj->ikn", pose.rotation_a, self.axes_a)
        return i, np.einsum("ijn,j->in", pose.rotation_b, self.axis_b)[:, None]


def across(axis: Axis) -> FloatArray:
    """Two unit vectors (2, 3) that form a right-handed frame with an axis."""
    direction = np.asarray(axis, dtype=np.float64)
    # The coordinate axis most across it; for z this gives x and y.
    helper = np.eye(3)[int(np.abs(direction).argmin())]
    first = helper - direction * (helper @ direction)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def _rate_matrix(vector: FloatArray, scalar: FloatArray) -> FloatArray:
    """The matrices w I - [e]; shape (3, 3, N)."""
    x, y, z = vector
    return np.array([[scalar, z, -y], [-z, scalar, x], [y, -x, scalar]])
