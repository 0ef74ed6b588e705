"""Residuals of loop closures in symbols; each kind of closure brings its own expressions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import pinocchio as pin

from loopid.export.codegen.joints import constant, elementary_joints
from loopid.export.codegen.tree import Frame
from loopid.robot import Mechanism, SymbolicPose


def closure_residual(mechanism: Mechanism, q: Any, frames: Sequence[Frame]) -> Any:
    """Residual (rows,) in m at positions (nq,) with the tree's frames there."""
    rows = []
    for closure in mechanism.closures:
        a, b = (_pose(mechanism.model, frames, frame) for frame in closure.frame_ids)
        for part in closure.equations:
            rows += part.expressions(a, b, ca)
    rows += [coupling.expression(q) for coupling in mechanism.couplings]
    return ca.vertcat(*rows) * ca.DM(mechanism.row_scales)


def position_rates(model: pin.Model, q: Any) -> Any:
    """Derivative (nq, nv) of positions by velocities."""
    blocks = []
    for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
        own = q[joint.idx_q : joint.idx_q + joint.nq]
        blocks += [part.rates for part in elementary_joints(name, joint, own)]
    return ca.diagcat(*blocks)


def _pose(model: pin.Model, frames: Sequence[Frame], index: int) -> SymbolicPose:
    frame = model.frames[index]
    carrier, (P, p) = frames[frame.parentJoint], constant(frame.placement)
    return SymbolicPose(carrier.rotation @ P, carrier.origin + carrier.rotation @ p)
