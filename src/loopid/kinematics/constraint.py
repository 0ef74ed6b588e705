"""Residual, Jacobian and drift of the loop closures, at closed and open configurations.

For each closure of frames a and b:

- ``3d``: r = p_a - p_b, along the fixed axes (m);
- ``6d``: these rows, then r = 2 vec(h) with h the unit quaternion of R_aᵀ R_b (rad for small
  angles). With w = scalar(h) >= 0, e = vec(h) and ω = R_aᵀ (ω_b - ω_a), dr/dt = (w I - [e]) ω,
  [e] being the cross-product matrix of e. Unlike the rotation logarithm it has a simple second
  derivative, and its Jacobian is regular up to half a turn.

The Jacobian A is the exact derivative of the residual, A v = dr/dt, and the drift is
d²r/dt² at zero acceleration, so that A a + drift = d²r/dt² [Featherstone2008, ch. 8].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from loopid.arrays import FloatArray, samples
from loopid.kinematics.frames import FrameKinematics, frame_accelerations, frame_kinematics
from loopid.mechanism import Mechanism


@dataclass(frozen=True)
class ConstraintValues:
    """Residual (N, rows) and Jacobian (N, rows, nv) of all closures."""

    residual: FloatArray
    jacobian: FloatArray


def constraint_values(mechanism: Mechanism, configurations: FloatArray) -> ConstraintValues:
    """Residual and Jacobian at configurations (N, nq)."""
    kinematics = frame_kinematics(mechanism, configurations, _frame_ids(mechanism))
    count = len(kinematics.origin)
    residuals, jacobians = [np.empty((count, 0))], [np.empty((count, 0, mechanism.model.nv))]
    for pair, closure in enumerate(mechanism.closures):
        a, b = 2 * pair, 2 * pair + 1
        residuals.append(kinematics.origin[:, a] - kinematics.origin[:, b])
        jacobians.append(kinematics.jacobian[:, a, :3] - kinematics.jacobian[:, b, :3])
        if closure.kind == "6d":
            residual, jacobian = _orientation(kinematics, a, b)
            residuals.append(residual)
            jacobians.append(jacobian)
    return ConstraintValues(np.concatenate(residuals, 1), np.concatenate(jacobians, 1))


def constraint_residual(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Residual (N, rows) of all closures: m, and twice the quaternion's vector for 6d."""
    return constraint_values(mechanism, configurations).residual


def constraint_jacobian(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Jacobian A (N, rows, nv): the exact derivative of the residual."""
    return constraint_values(mechanism, configurations).jacobian


def constraint_drift(
    mechanism: Mechanism, configurations: FloatArray, velocities: FloatArray
) -> FloatArray:
    """Drift (N, rows), the term of the residual's second derivative without acceleration.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq).
    velocities : FloatArray
        (N, nv), rad/s or m/s.
    """
    frame_ids = _frame_ids(mechanism)
    kinematics = frame_kinematics(mechanism, configurations, frame_ids)
    v = samples(velocities, mechanism.model.nv, "velocities", len(kinematics.origin))
    motion = np.einsum("nfij,nj->nfi", kinematics.jacobian, v)
    acceleration = frame_accelerations(mechanism, configurations, v, frame_ids)
    rows = [np.empty((len(v), 0))]
    for pair, closure in enumerate(mechanism.closures):
        a, b = 2 * pair, 2 * pair + 1
        rows.append(acceleration[:, a, :3] - acceleration[:, b, :3])
        if closure.kind == "6d":
            turn, turn_rate = motion[:, :, 3:], acceleration[:, :, 3:]
            rows.append(_orientation_drift(kinematics.rotation, turn, turn_rate, a, b))
    return np.concatenate(rows, 1)


def _frame_ids(mechanism: Mechanism) -> list[int]:
    return [frame for closure in mechanism.closures for frame in closure.frame_ids]


def _orientation(kinematics: FrameKinematics, a: int, b: int) -> tuple[FloatArray, FloatArray]:
    vector, scalar = relative_quaternion(kinematics.rotation[:, a], kinematics.rotation[:, b])
    turn = kinematics.jacobian[:, b, 3:] - kinematics.jacobian[:, a, 3:]
    in_frame_a = np.einsum("nji,njk->nik", kinematics.rotation[:, a], turn)
    return 2.0 * vector, _rate_matrix(vector, scalar) @ in_frame_a


def _orientation_drift(
    rotation: FloatArray, turn: FloatArray, turn_rate: FloatArray, a: int, b: int
) -> FloatArray:
    """Second derivative of 2 vec(h): M dω/dt + (dM/dt) ω with M = w I - [e]."""
    vector, scalar = relative_quaternion(rotation[:, a], rotation[:, b])
    to_a = rotation[:, a].transpose(0, 2, 1)
    omega = _apply(to_a, turn[:, b] - turn[:, a])
    # R_aᵀ turns with frame a, which adds -ω_a x (ω_b - ω_a) = -ω_a x ω_b.
    omega_rate = turn_rate[:, b] - turn_rate[:, a] - np.cross(turn[:, a], turn[:, b])
    matrix = _rate_matrix(vector, scalar)
    vector_rate = 0.5 * _apply(matrix, omega)
    scalar_rate = -0.5 * np.einsum("ni,ni->n", vector, omega)
    matrix_rate = _rate_matrix(vector_rate, scalar_rate)
    return _apply(matrix, _apply(to_a, omega_rate)) + _apply(matrix_rate, omega)


def relative_quaternion(
    rotation_a: FloatArray, rotation_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Vector (N, 3) and scalar (N,) of the quaternion of R_aᵀ R_b, with scalar >= 0."""
    relative = Rotation.from_matrix(np.einsum("nji,njk->nik", rotation_a, rotation_b))
    quaternion = relative.as_quat(canonical=True)
    return quaternion[:, :3], quaternion[:, 3]


def _rate_matrix(vector: FloatArray, scalar: FloatArray) -> FloatArray:
    """The matrices w I - [e]; shape (N, 3, 3)."""
    x, y, z = vector.T
    rows = [[scalar, z, -y], [-z, scalar, x], [y, -x, scalar]]
    return np.moveaxis(np.array(rows), 2, 0)


def _apply(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("nij,nj->ni", matrices, vectors), dtype=np.float64)
