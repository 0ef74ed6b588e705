"""Closures, couplings and platform of a robot file, looked up in the model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription, Vector
from loopid.loading.description import Description, PlatformDescription
from loopid.robot import CLOSURE_KINDS, JointCoupling, LoopClosure, Platform


def find_closures(
    file: Path, model: pin.Model, description: Description
) -> tuple[LoopClosure, ...]:
    """The closures of a description, each between two bodies of the model."""
    found = tuple(
        _closure(file, model, closure, *closure.frames)
        for closure in description.all_closures
        if closure.frames is not None
    )
    for k, closure in enumerate(found):
        ends = (closure.kind, set(closure.frame_ids))
        if any((other.kind, set(other.frame_ids)) == ends for other in found[:k]):
            raise RobotFileError(f"{file}: closure {closure.name} ({closure.kind}) is listed twice")
    return found


def _closure(
    file: Path, model: pin.Model, closure: ClosureDescription, frame_a: str, frame_b: str
) -> LoopClosure:
    ids = (_frame(file, model, frame_a), _frame(file, model, frame_b))
    joints = [model.frames[frame].parentJoint for frame in ids]
    if joints[0] == joints[1]:
        raise RobotFileError(
            f"{file}: closure {frame_a}-{frame_b} joins two frames of one body: it closes no loop"
        )
    default = CLOSURE_KINDS[closure.type].axes or ((0.0, 0.0, 1.0),) * 2
    first, second = closure.axes or default
    axes = _unit(first), _unit(second)
    return LoopClosure(closure.type, frame_a, frame_b, ids, axes, closure.length or 0.0)


def _unit(axis: Vector) -> Vector:
    # Of size one first, so that no square overflows or vanishes.
    direction = np.array(axis) / np.abs(axis).max()
    x, y, z = (float(part) for part in direction / np.linalg.norm(direction))
    return x, y, z


def find_couplings(
    file: Path, model: pin.Model, description: Description, locked: Mapping[str, float]
) -> tuple[JointCoupling, ...]:
    """The couplings of a description; joints that are locked add to the offset."""
    found = []
    for closure in description.all_closures:
        if closure.joints is None:
            continue
        coupling = _coupling(file, model, closure.joints, closure.offset, locked)
        if coupling is not None:
            found.append(coupling)
    _refuse_contradictions(file, found)
    return tuple(found)


def _coupling(
    file: Path,
    model: pin.Model,
    joints: dict[str, float],
    offset: float,
    locked: Mapping[str, float],
) -> JointCoupling | None:
    for name, coefficient in joints.items():
        offset -= coefficient * locked.get(name, 0.0)
    moving = {name: c for name, c in joints.items() if name not in locked}
    if not moving:
        return None
    models = [_single_joint(file, model, name) for name in moving]
    q, v = tuple(joint.idx_q for joint in models), tuple(joint.idx_v for joint in models)
    return JointCoupling(tuple(moving), tuple(moving.values()), offset, q, v)


def _single_joint(file: Path, model: pin.Model, name: str) -> pin.JointModel:
    if not model.existJointName(name):
        listed = ", ".join(list(model.names)[1:])
        raise RobotFileError(f"{file}: unknown joint {name!r} in a coupling: choose among {listed}")
    joint = model.joints[model.getJointId(name)]
    if joint.nq != 1:
        raise RobotFileError(f"{file}: joint {name} in a coupling has {joint.nv} coordinates")
    return joint


def _refuse_contradictions(file: Path, couplings: list[JointCoupling]) -> None:
    """Refuse linear equations that no coordinates satisfy."""
    if not couplings:
        return
    matrix = np.zeros((len(couplings), 1 + max(max(c.q_indices) for c in couplings)))
    for row, coupling in zip(matrix, couplings, strict=True):
        row[list(coupling.q_indices)] = coupling.coefficients
    matrix /= np.abs(matrix).max(axis=1, keepdims=True)
    offsets = np.array([c.offset / max(map(abs, c.coefficients)) for c in couplings])
    for k in range(1, len(couplings) + 1):
        solution = np.linalg.lstsq(matrix[:k], offsets[:k], rcond=1e-10)[0]
        left = np.abs(matrix[:k] @ solution - offsets[:k]).max()
        if left > 1e-9 * max(1.0, np.abs(offsets).max()):
            raise RobotFileError(
                f"{file}: coupling {couplings[k - 1].name} contradicts the ones before it"
            )


def _frame(file: Path, model: pin.Model, name: str) -> int:
    links = link_frames(model)
    if name in links:
        return links[name]
    # Joints have frames too; a link of the same name comes first.
    for frame_id, frame in enumerate(model.frames):
        if frame.name == name:
            return frame_id
    raise RobotFileError(f"{file}: unknown frame {name!r}: choose among {', '.join(links)}")


def link_frames(model: pin.Model) -> dict[str, int]:
    """Indices of the frames of all links, by name."""
    frames = enumerate(model.frames)
    return {frame.name: i for i, frame in frames if frame.type == pin.FrameType.BODY}


def find_platform(
    file: Path, model: pin.Model, description: PlatformDescription | None
) -> Platform | None:
    """The platform of a description, where it declares one."""
    if description is None:
        return None
    frame_id = _frame(file, model, description.frame)
    names, motions = tuple(description.coordinates), tuple(description.coordinates.values())
    return Platform(description.frame, frame_id, names, motions)
