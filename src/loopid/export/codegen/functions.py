"""The two functions that become C: the closures' Jacobian, and the regressor K = Gᵀ Y.

Between them a linear system is solved for the dependent coordinates, in C of its own: which
equations are redundant, and which pivots are large, depends on the pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from loopid.arrays import IntArray
from loopid.experiment import ForceModel
from loopid.export.codegen.joints import constant, elementary_joints
from loopid.export.codegen.tree import Frame, tree_frames
from loopid.kinematics import partition
from loopid.parameters import KINDS, Parameter
from loopid.regressors import JointTerms
from loopid.robot import JOINT_TERMS, JointState, Mechanism, SymbolicPose, tie_indices

OPTIONS: dict[str, Any] = {
    "with_mem": False,
    "with_header": False,
    "with_export": False,
    "casadi_int": "int",
}


def c_functions(model: ForceModel, name: str) -> str:
    """C source of functions ``<name>_closures`` and ``<name>_columns`` with what they need.

    ``closures(q) -> (M, residual)``: the Jacobian (rows, nv) in common units, columns of dependent
    coordinates first, and the residual (rows,) in m; without closures there is no such function.
    ``columns(q, v, a, X) -> K``: with X (dependent, dof) of M = [A B], A X = B, and K row by row.
    """
    generator = ca.CodeGenerator(name, OPTIONS)
    parts = partition(model.mechanism)
    if len(parts[1]):
        generator.add(_closures(model.mechanism, parts, f"{name}_closures"))
    generator.add(_columns(model, parts, f"{name}_columns"))
    return str(generator.dump())


def _closures(mechanism: Mechanism, parts: tuple[IntArray, IntArray], name: str) -> ca.Function:
    model = mechanism.model
    q, still = ca.SX.sym("q", model.nq), ca.SX(model.nv, 1)
    frames = tree_frames(model, q, still, still, ca.SX(model.nv, 0))
    residual = _closure_residual(mechanism, q, frames)
    jacobian = ca.jacobian(residual, q) @ _position_rates(model, q)
    scaled = jacobian @ ca.diag(ca.DM(mechanism.coordinate_scales))
    chosen, dependent = parts
    M = scaled[:, [*dependent.tolist(), *chosen.tolist()]]
    return ca.Function(name, [q], [ca.densify(M), ca.densify(residual)])


def _columns(model: ForceModel, parts: tuple[IntArray, IntArray], name: str) -> ca.Function:
    mechanism, (chosen, dependent) = model.mechanism, parts
    nq, nv, dof = mechanism.model.nq, mechanism.model.nv, len(chosen)
    q, v, a = ca.SX.sym("q", nq), ca.SX.sym("v", nv), ca.SX.sym("a", nv)
    X = ca.SX.sym("X", len(dependent), dof)
    G, scales = ca.SX(nv, dof), mechanism.coordinate_scales
    for column, j in enumerate(chosen.tolist()):
        G[j, column] = 1
        for row, i in enumerate(dependent.tolist()):
            G[i, column] = -X[row, column] * (scales[i] / scales[j])
    K = _base_columns(model, q, v, a, G)
    return ca.Function(name, [q, v, a, X], [ca.densify(K.T)])


def _base_columns(model: ForceModel, q: Any, v: Any, a: Any, G: Any) -> Any:
    """K (dof, n), body by body; in the ``gravity`` model bodies are at rest, joint terms move."""
    mechanism, still = model.mechanism, ca.SX(v.shape[0], 1)
    rates, second = (v, a) if model.model == "full" else (still, still)
    frames = tree_frames(mechanism.model, q, rates, second, G)
    wrenches = {body.joint_id: _wrenches(frames[body.joint_id]) for body in mechanism.bodies}
    # Joints of the bodies behind each name: several where links are tied.
    names = [parameter.link for parameter in mechanism.parameters("gravity")][::4]
    joints: dict[str, list[int]] = {name: [] for name in names}
    places = tie_indices(mechanism.links, mechanism.ties)
    for body, place in zip(mechanism.bodies, places, strict=True):
        joints[names[place]].append(body.joint_id)
    columns = []
    for parameter in model.parameters:
        if parameter.kind in KINDS:
            column = ca.SX(G.shape[1], 1)
            for joint in joints[parameter.link]:
                force, moment = wrenches[joint][KINDS.index(parameter.kind)]
                column += frames[joint].shift.T @ force + frames[joint].turn.T @ moment
        else:
            column = _joint_term(mechanism, model.joint_terms, parameter, q, v, a, G)
        columns.append(column)
    return ca.horzcat(*columns)


def _wrenches(frame: Frame) -> list[tuple[Any, Any]]:
    """Force and moment about the origin per unit of each of ten parameters, along the axes.

    f = m a + α x c + ω x (ω x c), n = c x a + I α + ω x I ω, with the acceleration a of the origin
    less gravity.
    """
    a = frame.acceleration + ca.cross(frame.omega, frame.velocity)
    spin = ca.skew(frame.omega)
    points = ca.skew(frame.alpha) + spin @ spin
    nothing = ca.SX(3, 1)
    wrenches = [(a, nothing)]
    for axis in np.eye(3):
        direction = ca.sparsify(ca.SX(axis))
        wrenches.append((points @ direction, ca.cross(direction, a)))
    for kind in KINDS[4:]:
        i, j = ("xyz".index(letter) for letter in kind[1:])
        unit = ca.SX(3, 3)
        unit[i, j] = unit[j, i] = 1
        wrenches.append((nothing, unit @ frame.alpha + spin @ (unit @ frame.omega)))
    return wrenches


def _joint_term(
    mechanism: Mechanism, terms: JointTerms | None, parameter: Parameter, *state: Any
) -> Any:
    """A joint term, by the law of its kind."""
    q, v, a, G = state
    index = int(mechanism.velocity_indices([parameter.link])[0])
    position = None
    if parameter.link in mechanism.joints:
        joint = mechanism.joint(parameter.link)
        position = q[joint.idx_q] if joint.nq == 1 else ca.atan2(q[joint.idx_q + 1], q[joint.idx_q])
    term, at = JOINT_TERMS[parameter.kind], JointState(position, v[index], a[index])
    return G[index, :].T * term.signal(at, terms or JointTerms(()), ca)


def _closure_residual(mechanism: Mechanism, q: Any, frames: Sequence[Frame]) -> Any:
    """Residual (rows,) in m at positions (nq,) with the tree's frames there."""
    rows = []
    for closure in mechanism.closures:
        a, b = (_pose(mechanism.model, frames, frame) for frame in closure.frame_ids)
        for part in closure.equations:
            rows += part.expressions(a, b, ca)
    rows += [coupling.expression(q) for coupling in mechanism.couplings]
    return ca.vertcat(*rows) * ca.DM(mechanism.row_scales)


def _position_rates(model: pin.Model, q: Any) -> Any:
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
