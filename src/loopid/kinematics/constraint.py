"""Residual, Jacobian and drift of all closures, at closed and open configurations.

The Jacobian A is the exact derivative of the residual, A v = dr/dt, and the drift is
d²r/dt² at zero acceleration, so that A a + drift = d²r/dt² [Featherstone2008, ch. 8]. The rows of
the loop closures come first, then one row a coupling of joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, samples
from loopid.kinematics.closure_rows import closure_rows
from loopid.kinematics.frames import FrameKinematics, frame_accelerations, frame_kinematics
from loopid.kinematics.pairs import PairMotion, PairPose
from loopid.mechanism import LoopClosure, Mechanism


@dataclass(frozen=True)
class ConstraintValues:
    """Residual (N, rows) and Jacobian (N, rows, nv) of all closures."""

    residual: FloatArray
    jacobian: FloatArray


def constraint_values(mechanism: Mechanism, configurations: FloatArray) -> ConstraintValues:
    """Residual and Jacobian at configurations (N, nq)."""
    q = samples(configurations, mechanism.model.nq, "configurations")
    residuals, jacobians = [np.empty((len(q), 0))], [np.empty((len(q), 0, mechanism.model.nv))]
    kinematics = frame_kinematics(mechanism, q, _frame_ids(mechanism))
    for closure, pose, _ in _pairs(mechanism, kinematics):
        for rows in closure_rows(closure):
            residuals.append(rows.residual(pose))
            jacobians.append(rows.jacobian(pose))
    matrix = _coupling_matrix(mechanism)
    residuals.append(_coupling_residual(mechanism, q))
    jacobians.append(np.broadcast_to(matrix, (len(q), *matrix.shape)))
    return ConstraintValues(np.concatenate(residuals, 1), np.concatenate(jacobians, 1))


def constraint_residual(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Residual (N, rows) of all closures: m or rad."""
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
    twists = np.einsum("nfij,nj->nfi", kinematics.jacobian, v)
    accelerations = frame_accelerations(mechanism, configurations, v, frame_ids)
    drifts: list[FloatArray] = []
    for closure, pose, (a, b) in _pairs(mechanism, kinematics):
        motion = PairMotion(twists[:, a], twists[:, b], accelerations[:, a], accelerations[:, b])
        drifts.extend(rows.drift(pose, motion) for rows in closure_rows(closure))
    # Couplings are linear in the coordinates.
    return np.concatenate([*drifts, np.zeros((len(v), len(mechanism.couplings)))], 1)


def _frame_ids(mechanism: Mechanism) -> list[int]:
    return [frame for closure in mechanism.closures for frame in closure.frame_ids]


def _pairs(
    mechanism: Mechanism, kinematics: FrameKinematics
) -> Iterator[tuple[LoopClosure, PairPose, tuple[int, int]]]:
    """Each closure with the pose of its frames and their places among all frames."""
    rotation, origin, jacobian = kinematics.rotation, kinematics.origin, kinematics.jacobian
    for pair, closure in enumerate(mechanism.closures):
        a, b = 2 * pair, 2 * pair + 1
        pose = PairPose(
            rotation_a=rotation[:, a],
            rotation_b=rotation[:, b],
            distance=origin[:, b] - origin[:, a],
            jacobian_a=jacobian[:, a],
            jacobian_b=jacobian[:, b],
        )
        yield closure, pose, (a, b)


def _coupling_matrix(mechanism: Mechanism) -> FloatArray:
    """Coefficients (k, nv) of the couplings."""
    matrix = np.zeros((len(mechanism.couplings), mechanism.model.nv))
    for row, coupling in zip(matrix, mechanism.couplings, strict=True):
        row[list(coupling.v_indices)] = coupling.coefficients
    return matrix


def _coupling_residual(mechanism: Mechanism, q: FloatArray) -> FloatArray:
    sums = [
        q[:, list(coupling.q_indices)] @ np.array(coupling.coefficients) - coupling.offset
        for coupling in mechanism.couplings
    ]
    return np.stack(sums, axis=1) if sums else np.empty((len(q), 0))
