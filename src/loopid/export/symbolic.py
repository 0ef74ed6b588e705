"""The robot in CasADi's symbols, and the two functions that become C: closures, and K = Gᵀ Y.

Every joint is a chain of elementary ones, whose velocity along their own frame is a constant matrix
times their coordinates' rates, as Pinocchio defines them. The recursion of [Featherstone2008, ch.
5] hands twists and accelerations from parent to child and turns them into its axes, so that most
entries of axes stay zero.

Between the two functions a linear system is solved for the dependent coordinates, in C of its own:
which equations are redundant, and which pivots are large, depends on the pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray, IntArray
from loopid.errors import OptionError
from loopid.identification.force_model import ForceModel
from loopid.kinematics.projection import partition
from loopid.parameters import KINDS, Parameter
from loopid.regressors.joint_laws import JointState, joint_term
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.closures import SymbolicPose
from loopid.robot.mechanism import Mechanism

ROUND_OFF = 1e-15  # entries of rotations that are this close to -1, 0 or 1 are meant to be
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
    places = mechanism.tie_indices
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
    position = None  # of one of several coordinates
    if parameter.link in mechanism.joints:
        joint = mechanism.joint(parameter.link)
        position = q[joint.idx_q] if joint.nq == 1 else ca.atan2(q[joint.idx_q + 1], q[joint.idx_q])
    term, at = joint_term(parameter.kind), JointState(position, v[index], a[index])
    if "load" in term.needs:
        raise OptionError(
            f"C code cannot have {parameter.label}, as it does not compute what joints carry: "
            f"identify without {parameter.kind} for it",
            parameter=parameter.label,
        )
    state = (terms or JointTerms(())).state(at, math=ca)
    return G[index, :].T * term.law(state, term.at)


def _closure_residual(mechanism: Mechanism, q: Any, frames: Sequence[Frame]) -> Any:
    """Residual (rows,) in m at positions (nq,) with the tree's frames there."""
    rows = []
    for closure in mechanism.closures:
        a, b = (_pose(mechanism.model, frames, frame) for frame in closure.frame_ids)
        for part in closure.equations:
            rows += part.expressions(a, b, ca)
        if closure.indices is not None:
            rows[-1] -= q[closure.indices[0]]
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


@dataclass(frozen=True)
class Frame:
    """A frame in symbols, along its own axes but for its pose."""

    # Pose in the fixed frame, (3, 3) and (3,)
    rotation: Any
    origin: Any
    # Twist and its spatial rate, (3,) each; the ground accelerates against gravity
    omega: Any
    velocity: Any
    alpha: Any
    acceleration: Any
    # Angular and linear velocity per unit of each independent coordinate, (3, dof)
    turn: Any
    shift: Any


def tree_frames(model: pin.Model, q: Any, v: Any, a: Any, G: Any) -> list[Frame]:
    """Frames of the joints by index, the ground first.

    Parameters
    ----------
    q, v, a : casadi.SX
        (nq,), (nv,), (nv,).
    G : casadi.SX
        (nv, dof), all velocities per unit of the independent ones.
    """
    zero, none = ca.SX(3, 1), ca.SX(3, G.shape[1])
    up = ca.sparsify(ca.SX(-model.gravity.linear))
    frames = [Frame(ca.SX.eye(3), zero, zero, zero, zero, up, none, none)]
    for index in range(1, model.njoints):
        joint, frame = model.joints[index], frames[model.parents[index]]
        own = q[joint.idx_q : joint.idx_q + joint.nq]
        first, mount = joint.idx_v, model.jointPlacements[index]
        for part in elementary_joints(model.names[index], joint, own):
            rows = slice(first, first + part.angular.shape[1])
            first = rows.stop
            frame = _carried(frame, mount * part.before, part, v[rows], a[rows], G[rows, :])
            mount = pin.SE3.Identity()
        frames.append(frame)
    return frames


def _carried(frame: Frame, mount: pin.SE3, joint: Any, v: Any, a: Any, G: Any) -> Frame:
    """The frame that a joint carries on another one."""
    P, p = constant(mount)
    R, r = P @ joint.rotation, p + P @ joint.translation
    own_turn, own_shift = joint.angular @ v, joint.linear @ v
    omega = R.T @ frame.omega + own_turn
    velocity = R.T @ (frame.velocity + ca.cross(frame.omega, r)) + own_shift
    alpha = R.T @ frame.alpha + joint.angular @ a + ca.cross(omega, own_turn)
    acceleration = R.T @ (frame.acceleration + ca.cross(frame.alpha, r)) + joint.linear @ a
    acceleration += ca.cross(omega, own_shift) + ca.cross(velocity, own_turn)
    return Frame(
        rotation=frame.rotation @ R,
        origin=frame.origin + frame.rotation @ r,
        omega=omega,
        velocity=velocity,
        alpha=alpha,
        acceleration=acceleration,
        turn=R.T @ frame.turn + joint.angular @ G,
        shift=R.T @ (frame.shift - ca.skew(r) @ frame.turn) + joint.linear @ G,
    )


@dataclass(frozen=True)
class ElementaryJoint:
    """A joint in symbols."""

    before: pin.SE3  # where it is mounted
    rotation: Any  # (3, 3), its motion from there
    translation: Any  # (3,)
    angular: Any  # (3, nv), velocity along its own frame per unit of each coordinate
    linear: Any  # (3, nv)
    rates: Any  # (nq, nv), derivative of its position by its velocity


def elementary_joints(name: str, joint: pin.JointModel, q: Any) -> list[ElementaryJoint]:
    """The chain that a joint is, at symbolic positions (nq,)."""
    chain, first = [], 0
    for part, placement in _parts(joint):
        kind = part.shortname().removeprefix("JointModel")
        own = q[first : first + part.nq]
        first += part.nq
        if kind in SEVERAL:
            chain.append(SEVERAL[kind](placement, own))
        elif part.nv == 1:
            chain.append(_single(part, placement, own))
        else:
            message = f"joint {name} is a {kind}, which has no symbolic form here"
            raise OptionError(message, joint=name, kind=kind)
    return chain


def _parts(joint: pin.JointModel) -> list[tuple[pin.JointModel, pin.SE3]]:
    """Joints of one kind of motion each, with their placements behind one another."""
    kind, start = joint.shortname().removeprefix("JointModel"), pin.SE3.Identity()
    if kind == "Composite":
        joint = joint.extract() if isinstance(joint, pin.JointModel) else joint
        return [
            (part, where * there if k == 0 else there)
            for own, where in zip(joint.joints, joint.jointPlacements, strict=True)
            for k, (part, there) in enumerate(_parts(own))
        ]
    if kind == "SphericalZYX":
        return [(turn(), start) for turn in (pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)]
    if kind == "Universal":
        axes = np.asarray(_subspace(joint)).reshape(6, 2)[3:].T
        return [(pin.JointModelRevoluteUnaligned(axis.copy()), start) for axis in axes]
    return [(joint, start)]


def _subspace(joint: pin.JointModel) -> FloatArray:
    """Velocity (6, nv) at position zero, linear above angular."""
    data = joint.createData()
    q = np.zeros(max(joint.idx_q, 0) + joint.nq)
    joint.calc(data, q)
    return np.asarray(data.S, dtype=np.float64).reshape(6, -1)


def _single(joint: pin.JointModel, before: pin.SE3, q: Any) -> ElementaryJoint:
    """A turn, a displacement, or both: hinges, sliders and screws."""
    axis = exact(_subspace(joint)[:, 0])
    linear, angular = ca.DM(axis[:3]), ca.DM(axis[3:])
    if joint.nq == 2:  # A continuous joint has the cosine and the sine of its angle.
        cosine, sine, rates = q[0], q[1], ca.vertcat(-q[1], q[0])
    else:
        cosine, sine, rates = ca.cos(q), ca.sin(q), ca.SX.ones(1, 1)
    rotation = _rodrigues(angular, cosine, sine) if axis[3:].any() else ca.SX.eye(3)
    moved = linear * q if axis[:3].any() else ca.SX(3, 1)
    return ElementaryJoint(
        before, rotation, moved, ca.sparsify(angular), ca.sparsify(linear), rates
    )


def _rodrigues(axis: Any, cosine: Any, sine: Any) -> Any:
    cross = ca.sparsify(ca.skew(axis))
    square = ca.sparsify(cross @ cross)
    return ca.SX.eye(3) + sine * cross + (1 - cosine) * square


def _spherical(before: pin.SE3, q: Any) -> ElementaryJoint:
    nothing = ca.DM(3, 3)
    return ElementaryJoint(
        before, _rotation(q), ca.SX(3, 1), ca.DM.eye(3), nothing, _quaternion_rates(q)
    )


def _free(before: pin.SE3, q: Any) -> ElementaryJoint:
    R = _rotation(q[3:])
    eye, nothing = ca.DM.eye(3), ca.DM(3, 3)
    rates = ca.diagcat(R, _quaternion_rates(q[3:]))
    angular, linear = ca.horzcat(nothing, eye), ca.horzcat(eye, nothing)
    return ElementaryJoint(before, R, q[:3], angular, linear, rates)


def _planar(before: pin.SE3, q: Any) -> ElementaryJoint:
    cosine, sine = q[2], q[3]
    R = _rodrigues(ca.DM([0, 0, 1]), cosine, sine)
    rates = ca.diagcat(R[:2, :2], ca.vertcat(-sine, cosine))
    linear, angular = ca.diagcat(ca.DM.eye(2), ca.DM(1, 1)), ca.DM(3, 3)
    angular[2, 2] = 1
    translation = ca.vertcat(q[:2], ca.SX(1, 1))
    return ElementaryJoint(before, R, translation, angular, linear, rates)


def _translation(before: pin.SE3, q: Any) -> ElementaryJoint:
    eye = ca.DM.eye(3)
    return ElementaryJoint(before, ca.SX.eye(3), q, ca.DM(3, 3), eye, ca.SX.eye(3))


# Joints with several coordinates whose velocities are constant along their own frame.
SEVERAL = {
    "Spherical": _spherical,
    "FreeFlyer": _free,
    "Planar": _planar,
    "Translation": _translation,
}


def _rotation(quaternion: Any) -> Any:
    """Rotation of a unit quaternion x, y, z, w."""
    x, y, z, w = (quaternion[k] for k in range(4))
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def _quaternion_rates(quaternion: Any) -> Any:
    """Rates (4, 3) of a quaternion per unit of angular velocity along the turned axes."""
    x, y, z, w = (quaternion[k] for k in range(4))
    rows = ((w, -z, y), (z, w, -x), (-y, x, w), (-x, -y, -z))
    return 0.5 * ca.vertcat(*(ca.horzcat(*row) for row in rows))


def exact(entries: FloatArray) -> FloatArray:
    """Entries of unit vectors and rotations with the round-off of -1, 0 and 1 taken off."""
    whole = np.round(entries)
    return np.asarray(np.where(np.abs(entries - whole) < ROUND_OFF, whole, entries))


def constant(placement: pin.SE3) -> tuple[Any, Any]:
    """Rotation and translation of a placement without zeros."""
    R, p = ca.DM(exact(placement.rotation)), ca.DM(placement.translation)
    return ca.sparsify(R), ca.sparsify(p)
