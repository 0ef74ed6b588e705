"""Closures, couplings and frames that a description names, in the model of the tree."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from loopid.errors import ModelWarning, RobotFileError, warn
from loopid.loading.description import ClosureDescription, Vector
from loopid.numbers import FIT_ROUND_OFF
from loopid.robot.closures import CLOSURE_KINDS, JointCoupling, LoopClosure
from loopid.robot.robot import link_frames

ROUNDED = 0.1  # by which the length of a unit vector in a file may be off one


def warn_of_size(where: str, axis: Iterable[float]) -> None:
    """Warn of an axis whose length hardly is that of a rounded unit vector."""
    numbers = [*axis]
    if not abs(math.hypot(*numbers) - 1) < ROUNDED:
        text = ", ".join(f"{number:g}" for number in numbers)
        warn(f"{where}: axis ({text}) is no unit vector: its direction counts", ModelWarning)


def joint_named(model: pin.Model, name: str, where: str) -> pin.JointModel:
    """Joint of a name; where there is none, an error that lists the joints."""
    names = tuple(model.names)[1:]
    RobotFileError.require("joint", name, names, f" {where}")
    return model.joints[model.getJointId(name)]


def find_closures(
    where: object, model: pin.Model, described: Iterable[ClosureDescription]
) -> tuple[LoopClosure, ...]:
    """Closures, each between frames of two bodies of the model."""
    found = tuple(
        _closure(where, model, closure, *closure.frames)
        for closure in described
        if closure.frames is not None
    )
    for k, closure in enumerate(found):
        ends = (closure.kind, set(closure.frame_ids))
        if any((other.kind, set(other.frame_ids)) == ends for other in found[:k]):
            raise RobotFileError(f"closure {closure.name} ({closure.kind}) is listed twice")
    return found


def _closure(
    where: object, model: pin.Model, closure: ClosureDescription, frame_a: str, frame_b: str
) -> LoopClosure:
    name, ids = closure.label, (frame_named(model, frame_a), frame_named(model, frame_b))
    joints = [model.frames[frame].parentJoint for frame in ids]
    if joints[0] == joints[1] and closure.joint is None:
        raise RobotFileError(f"closure {name} joins two frames of one body: leave it out")
    default = CLOSURE_KINDS[closure.type].axes or ((0.0, 0.0, 1.0),) * 2
    first, second = closure.axes or default
    for axis in dict.fromkeys((first, second)):
        warn_of_size(f"{where}: closure {name}", axis)
    axes, indices = (_unit(first), _unit(second)), None
    if closure.joint is not None:
        sliding = joint_named(model, closure.joint, f"in closure {name}")
        if not sliding.shortname().startswith("JointModelP") or sliding.nv > 1:
            raise RobotFileError(
                f"closure {name}: joint {closure.joint} must slide, as its value is a length"
            )
        indices = sliding.idx_q, sliding.idx_v
    numbers = closure.length or 0.0, closure.joint, indices
    return LoopClosure(closure.type, frame_a, frame_b, ids, axes, *numbers, name=name)


def _unit(axis: Vector) -> Vector:
    # Of size one first, so that no square overflows or vanishes.
    direction = np.array(axis) / np.abs(axis).max()
    x, y, z = (float(part) for part in direction / np.linalg.norm(direction))
    return x, y, z


def frame_named(model: pin.Model, name: str) -> int:
    """Index of the frame of a link or, where no link has the name, of a joint or site."""
    links = link_frames(model)
    if name in links:
        return links[name]
    # Joints have frames too; a link of the same name comes first.
    for frame_id, frame in enumerate(model.frames):
        if frame.name == name:
            return frame_id
    raise RobotFileError.unknown("frame", name, links)


def find_couplings(
    where: object,
    model: pin.Model,
    described: Iterable[ClosureDescription],
    locked: Mapping[str, float | None],
) -> tuple[JointCoupling, ...]:
    """Couplings; joints that are locked count with their values."""
    held = {name: value for name, value in locked.items() if value is not None}
    couplings = (closure for closure in described if closure.joints is not None)
    found = [each for c in couplings if (each := _coupling(model, c, held)) is not None]
    _refuse_contradictions(where, [each for each in found if not each.powers])
    return tuple(found)


def _coupling(
    model: pin.Model, closure: ClosureDescription, locked: Mapping[str, float]
) -> JointCoupling | None:
    joints, argument = dict(closure.joints or {}), dict(closure.of or {})
    held = sum(factor * locked.get(name, 0.0) for name, factor in joints.items())
    shift = sum(factor * locked.get(name, 0.0) for name, factor in argument.items())
    # In terms of what moves; a constant and a slope are linear.
    curve = Polynomial(closure.polynomial or [closure.offset])(Polynomial([shift, 1.0]))
    moving = {name: c for name, c in joints.items() if name not in locked}
    argument = {name: factor for name, factor in argument.items() if name not in locked}
    constant, slope, *powers = [*curve.coef.tolist(), 0.0][: max(2, len(curve.coef))]
    for name, factor in argument.items():
        moving[name] = moving.get(name, 0.0) - slope * factor
    if not argument or not any(powers):
        argument, powers = {}, []
        moving = {name: c for name, c in moving.items() if c != 0}
    if not moving:
        return None
    models = [joint_named(model, name, "in a coupling") for name in moving]
    for name, joint in zip(moving, models, strict=True):
        if joint.nq != 1:
            said = f"joint {name} in a coupling has {joint.nv} coordinates"
            raise RobotFileError(said)
    return JointCoupling(
        joints=tuple(moving),
        coefficients=tuple(moving.values()),
        offset=constant - held,
        q_indices=tuple(joint.idx_q for joint in models),
        v_indices=tuple(joint.idx_v for joint in models),
        argument=tuple(argument.get(name, 0.0) for name in moving) if argument else (),
        powers=tuple(powers),
    )


def _refuse_contradictions(where: object, couplings: list[JointCoupling]) -> None:
    """Refuse linear equations that no coordinates satisfy, and name those that say nothing new."""
    if not couplings:
        return
    before = 0
    matrix = np.zeros((len(couplings), 1 + max(max(c.q_indices) for c in couplings)))
    for row, coupling in zip(matrix, couplings, strict=True):
        row[list(coupling.q_indices)] = coupling.coefficients
    matrix /= np.abs(matrix).max(axis=1, keepdims=True)
    offsets = np.array([c.offset / max(map(abs, c.coefficients)) for c in couplings])
    for k in range(1, len(couplings) + 1):
        name = couplings[k - 1].name
        solution, _, rank, _ = np.linalg.lstsq(matrix[:k], offsets[:k], rcond=FIT_ROUND_OFF)
        left = np.abs(matrix[:k] @ solution - offsets[:k]).max()
        if left > 10 * FIT_ROUND_OFF * max(1.0, np.abs(offsets).max()):
            raise RobotFileError(
                f"coupling {name} contradicts the ones before it: leave one of them out, those of "
                "the tree's own file by 'remove_closures' in a YAML"
            )
        if rank == before:
            warn(f"{where}: coupling {name} follows from the ones before it", ModelWarning)
        before = rank
