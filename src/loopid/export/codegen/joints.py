"""Joints in symbols: how each places its frame and moves it.

Every joint is a chain of elementary ones, whose velocity along their own frame is a constant matrix
times their coordinates' rates, as Pinocchio defines them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.errors import OptionError

ROUND_OFF = 1e-15  # entries of rotations that are this close to -1, 0 or 1 are meant to be


@dataclass(frozen=True)
class ElementaryJoint:
    """A joint in symbols.

    Attributes
    ----------
    before : pinocchio.SE3
        Where it is mounted.
    rotation, translation : casadi.SX
        (3, 3) and (3,), its motion from there.
    angular, linear : casadi.DM
        (3, nv), velocity along its own frame per unit of each coordinate.
    rates : casadi.SX
        (nq, nv), derivative of its position by its velocity.
    """

    before: pin.SE3
    rotation: Any
    translation: Any
    angular: Any
    linear: Any
    rates: Any


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
            raise OptionError(f"joint {name} is a {kind}, which has no symbolic form here")
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
