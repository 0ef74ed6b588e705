"""What every elementary row of a loop closure is a function of: two frames and their motion.

Arrays hold components first, along the fixed axes, and samples last.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from loopid.arrays import FloatArray
from loopid.kinematics.frame_poses import FramePoses
from loopid.kinematics.spans import Span


@dataclass(frozen=True)
class FramePair:
    """Frames a and b of a closure, by their numbers in a set, and what moves them.

    Attributes
    ----------
    a, b : int
    columns : Span
        Velocity indices of the c coordinates that move either frame.
    count : int
        Their number c.
    at_a, at_b : Span
        Where among these are those that move a, and those that move b.
    """

    a: int
    b: int
    columns: Span
    count: int
    at_a: Span
    at_b: Span


@dataclass(frozen=True)
class PairPose:
    """Two frames at N samples."""

    poses: FramePoses
    pair: FramePair

    @property
    def rotation_a(self) -> FloatArray:
        """(3, 3, N)."""
        return self.poses.rotation[:, :, self.pair.a]

    @property
    def rotation_b(self) -> FloatArray:
        """(3, 3, N)."""
        return self.poses.rotation[:, :, self.pair.b]

    @cached_property
    def distance(self) -> FloatArray:
        """(3, N), from the origin of a to that of b."""
        return self.poses.origin[:, self.pair.b] - self.poses.origin[:, self.pair.a]

    @cached_property
    def quaternion(self) -> tuple[FloatArray, FloatArray]:
        """Vector (3, N) and scalar (N,) of the quaternion that turns frame a into frame b."""
        rotations = (np.moveaxis(R, 2, 0) for R in (self.rotation_a, self.rotation_b))
        vector, scalar = relative_quaternion(*rotations)
        return vector.T, scalar

    @cached_property
    def shift(self) -> FloatArray:
        """(3, c, N), rate of the distance per unit of each coordinate."""
        return self._relative(self.poses.linear_columns)

    @cached_property
    def turn(self) -> FloatArray:
        """(3, c, N), angular velocity of b less that of a."""
        return self._relative(self.poses.angular_columns)

    @cached_property
    def turn_a(self) -> FloatArray:
        """(3, c, N), angular velocity of a."""
        columns = self.poses.angular_columns
        turn = np.zeros((3, self.pair.count, columns.shape[2]))
        turn[:, self.pair.at_a] = columns[:, self.poses.frames.spans[self.pair.a]]
        return turn

    def _relative(self, columns: FloatArray) -> FloatArray:
        """What moves b less what moves a, of the columns (3, P, N) of all frames."""
        pair, spans = self.pair, self.poses.frames.spans
        relative = np.zeros((3, pair.count, columns.shape[2]))
        relative[:, pair.at_b] = columns[:, spans[pair.b]]
        relative[:, pair.at_a] -= columns[:, spans[pair.a]]
        return relative


@dataclass(frozen=True)
class PairMotion:
    """How the frames move, all (3, N); accelerations are at zero joint acceleration.

    Attributes
    ----------
    rate, acceleration : FloatArray
        Of the distance.
    turn_a, turn_b : FloatArray
        Angular velocities.
    turning_a, turning_b : FloatArray
        Angular accelerations.
    """

    rate: FloatArray
    acceleration: FloatArray
    turn_a: FloatArray
    turn_b: FloatArray
    turning_a: FloatArray
    turning_b: FloatArray


class Rows(ABC):
    """Some scalar equations between two frames."""

    count: int
    angular = False  # whether the residual is an angle

    @abstractmethod
    def residual(self, pose: PairPose) -> FloatArray:
        """Residual (count, N)."""

    @abstractmethod
    def jacobian(self, pose: PairPose) -> FloatArray:
        """Its derivative (count, c, N)."""

    @abstractmethod
    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        """Its second derivative by time (count, N) at zero joint acceleration."""


def relative_quaternion(
    rotation_a: FloatArray, rotation_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Vector (N, 3) and scalar (N,) of the quaternion of R_aᵀ R_b (N, 3, 3), with scalar >= 0."""
    relative = Rotation.from_matrix(np.einsum("nji,njk->nik", rotation_a, rotation_b))
    quaternion = relative.as_quat(canonical=True)
    return quaternion[:, :3], quaternion[:, 3]
