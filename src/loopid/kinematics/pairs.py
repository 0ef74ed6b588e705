"""What every elementary row of a loop closure is a function of: two frames and their motion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from loopid.arrays import FloatArray


@dataclass(frozen=True)
class PairPose:
    """Two frames at N samples: rotations (N, 3, 3), origins (N, 3), Jacobians (N, 6, nv)."""

    rotation_a: FloatArray
    rotation_b: FloatArray
    distance: FloatArray
    jacobian_a: FloatArray
    jacobian_b: FloatArray

    @cached_property
    def quaternion(self) -> tuple[FloatArray, FloatArray]:
        """Vector (N, 3) and scalar (N,) of the quaternion that turns frame a into frame b."""
        return relative_quaternion(self.rotation_a, self.rotation_b)


@dataclass(frozen=True)
class PairMotion:
    """Twists and accelerations (N, 6) of two frames, at zero joint acceleration."""

    twist_a: FloatArray
    twist_b: FloatArray
    acceleration_a: FloatArray
    acceleration_b: FloatArray


class Rows(ABC):
    """Some scalar equations between two frames."""

    count: int
    angular = False  # whether the residual is an angle

    @abstractmethod
    def residual(self, pose: PairPose) -> FloatArray:
        """Residual (N, count)."""

    @abstractmethod
    def jacobian(self, pose: PairPose) -> FloatArray:
        """Its derivative (N, count, nv)."""

    @abstractmethod
    def drift(self, pose: PairPose, motion: PairMotion) -> FloatArray:
        """Its second derivative by time (N, count) at zero joint acceleration."""


def relative_quaternion(
    rotation_a: FloatArray, rotation_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Vector (N, 3) and scalar (N,) of the quaternion of R_aᵀ R_b, with scalar >= 0."""
    relative = Rotation.from_matrix(np.einsum("nji,njk->nik", rotation_a, rotation_b))
    quaternion = relative.as_quat(canonical=True)
    return quaternion[:, :3], quaternion[:, 3]


def dot(one: FloatArray, two: FloatArray) -> FloatArray:
    """Scalar products of stacked vectors."""
    return np.asarray((one * two).sum(axis=-1), dtype=np.float64)


def apply(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Products of stacked matrices (N, i, j) and vectors (N, j)."""
    return np.asarray(np.einsum("nij,nj->ni", matrices, vectors), dtype=np.float64)
