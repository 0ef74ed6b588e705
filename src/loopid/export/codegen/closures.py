"""Residuals of loop closures in symbols, in the units of ``row_scales``; see ``closure_rows``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from loopid.export.codegen.joints import constant, elementary_joints
from loopid.export.codegen.tree import Frame
from loopid.kinematics.orientation_rows import across
from loopid.kinematics.scaling import row_scales
from loopid.robot import LoopClosure, Mechanism
from loopid.robot.closure import Axis

Pose = tuple[Any, Any]  # rotation and origin


def closure_residual(mechanism: Mechanism, q: Any, frames: Sequence[Frame]) -> Any:
    """Residual (rows,) in m at positions (nq,) with the tree's frames there."""
    rows = []
    for closure in mechanism.closures:
        ends = (_pose(mechanism.model, frames, frame) for frame in closure.frame_ids)
        rows += _rows(closure, *ends)
    for coupling in mechanism.couplings:
        pairs = zip(coupling.coefficients, coupling.q_indices, strict=True)
        rows.append(sum(c * q[k] for c, k in pairs) - coupling.offset)
    return ca.vertcat(*rows) * ca.DM(row_scales(mechanism))


def position_rates(model: pin.Model, q: Any) -> Any:
    """Derivative (nq, nv) of positions by velocities."""
    blocks = []
    for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
        own = q[joint.idx_q : joint.idx_q + joint.nq]
        blocks += [part.rates for part in elementary_joints(name, joint, own)]
    return ca.diagcat(*blocks)


def _pose(model: pin.Model, frames: Sequence[Frame], index: int) -> Pose:
    frame = model.frames[index]
    carrier, (P, p) = frames[frame.parentJoint], constant(frame.placement)
    return carrier.rotation @ P, carrier.origin + carrier.rotation @ p


def _rows(closure: LoopClosure, a: Pose, b: Pose) -> list[Any]:
    kind, (axis_a, axis_b) = closure.kind, closure.axes
    d = b[1] - a[1]
    if kind == "distance":
        return [(ca.dot(d, d) - closure.length**2) / (2 * closure.length)]
    position = -d if kind in ("3d", "6d", "hinge", "universal") else _across(a, axis_a).T @ d
    if kind in ("3d", "2d"):
        return [position]
    if kind in ("6d", "prismatic"):
        return [position, _turn(a[0].T @ b[0])]
    carried = b[0] @ ca.DM(axis_b)
    along = ca.dot(a[0] @ ca.DM(axis_a), carried)
    if kind == "universal":
        return [position, along]
    return [position, 2 * (_across(a, axis_a).T @ carried) / (1 + along)]


def _across(a: Pose, axis: Axis) -> Any:
    """The two directions (3, 2) across an axis of frame a, along the fixed axes."""
    return a[0] @ ca.sparsify(ca.DM(np.ascontiguousarray(across(axis).T)))


def _turn(R: Any) -> Any:
    """Twice the vector of the quaternion of a rotation with scalar above zero."""
    vector = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    return vector / ca.sqrt(1 + R[0, 0] + R[1, 1] + R[2, 2])
