"""Poses and motion of the bodies of a tree in symbols, each along the axes of its own frame.

The recursion of [Featherstone2008, ch. 5]: twists and accelerations are handed from parent to child
and turned into its axes, so that most entries of axes stay zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import pinocchio as pin

from loopid.export.codegen.joints import constant, elementary_joints


@dataclass(frozen=True)
class Frame:
    """A frame in symbols, along its own axes but for its pose.

    Attributes
    ----------
    rotation, origin : casadi.SX
        (3, 3) and (3,), of the pose in the fixed frame.
    omega, velocity, alpha, acceleration : casadi.SX
        (3,), twist and its spatial rate; the ground accelerates against gravity.
    turn, shift : casadi.SX
        (3, dof), angular and linear velocity per unit of each independent coordinate.
    """

    rotation: Any
    origin: Any
    omega: Any
    velocity: Any
    alpha: Any
    acceleration: Any
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
