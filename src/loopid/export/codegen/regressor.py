"""The base columns of the projected regressor in symbols: K = Gᵀ Y, body by body."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from loopid.experiment import ForceModel
from loopid.export.codegen.tree import Frame, tree_frames
from loopid.parameters import KINDS, Parameter, model_kinds
from loopid.regressors import JOINT_TERMS, JointState, JointTerms
from loopid.robot import Mechanism, tie_indices


def base_columns(model: ForceModel, q: Any, v: Any, a: Any, G: Any) -> Any:
    """K (dof, n) at positions (nq,), velocities and accelerations (nv,), and G (nv, dof).

    In the ``gravity`` model bodies are at rest, and joint terms move.
    """
    mechanism = model.mechanism
    still = ca.SX(v.shape[0], 1)
    resting = model_kinds(model.model) != KINDS
    rates, second = (still, still) if resting else (v, a)
    frames = tree_frames(mechanism.model, q, rates, second, G)
    wrenches = {body.joint_id: _wrenches(frames[body.joint_id]) for body in mechanism.bodies}
    bodies = _bodies_by_name(mechanism)
    columns = []
    for parameter in model.parameters:
        if parameter.link in bodies and parameter.kind in KINDS:
            column = ca.SX(G.shape[1], 1)
            for joint in bodies[parameter.link]:
                force, moment = wrenches[joint][KINDS.index(parameter.kind)]
                column += frames[joint].shift.T @ force + frames[joint].turn.T @ moment
        else:
            column = _joint_term(mechanism, model.joint_terms, parameter, q, v, a, G)
        columns.append(column)
    return ca.horzcat(*columns)


def _bodies_by_name(mechanism: Mechanism) -> dict[str, list[int]]:
    """Joints of the bodies behind each name: several where links are tied."""
    names = [parameter.link for parameter in mechanism.parameters("full")][:: len(KINDS)]
    joints: dict[str, list[int]] = {name: [] for name in names}
    for body, place in zip(
        mechanism.bodies, tie_indices(mechanism.links, mechanism.ties), strict=True
    ):
        joints[names[place]].append(body.joint_id)
    return joints


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
    mechanism: Mechanism,
    terms: JointTerms | None,
    parameter: Parameter,
    q: Any,
    v: Any,
    a: Any,
    G: Any,
) -> Any:
    """A drive inertia, friction or offset, by the law of its kind."""
    index = int(mechanism.velocity_indices([parameter.link])[0])
    joint = mechanism.joint(parameter.link)
    position = q[joint.idx_q] if joint.nq == 1 else ca.atan2(q[joint.idx_q + 1], q[joint.idx_q])
    term, state = JOINT_TERMS[parameter.kind], JointState(position, v[index], a[index])
    return G[index, :].T * term.signal(state, terms or JointTerms(()), ca)
