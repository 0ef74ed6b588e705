"""Joints that no motor moves, as sensors tell them: floating bases, encoders of passive joints.

A base that floats has the pose of its frame, position and quaternion, as a state estimator or
cameras tell. Its velocity is along its own axes, v = log(q_k⁻¹ q_k+1) / h between two samples.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loopid.arguments import FloatArray, finite, samples
from loopid.errors import DataError, OptionError
from loopid.kinematics.measured import JointCoordinates
from loopid.kinematics.poses import difference
from loopid.motion.filtering import differentiate
from loopid.robot.mechanism import Mechanism, lock_options

if TYPE_CHECKING:
    from loopid.logs.log import Log

# Columns of a pose; a joint with one coordinate has one.
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
UNIT = 0.1  # by which the length of a measured quaternion may be off one


def free_values(joint: str, values: ArrayLike, count: int) -> FloatArray:
    """Checked values (N, 1) of a joint, or (N, 7) poses with quaternions that do not jump."""
    found = finite(values, joint)
    found = found[:, None] if found.ndim == 1 else found
    width = len(POSE) if found.ndim == 2 and found.shape[1] != 1 else 1
    return continued(samples(found, width, joint, count))


def continued(values: FloatArray) -> FloatArray:
    """Poses (N, 7) whose quaternions keep their sign from sample to sample; others as they are."""
    turn = values[:, 3:]
    if not turn.shape[1]:
        return values
    off = np.abs(np.linalg.norm(turn, axis=1) - 1)
    if off.max(initial=0.0) > UNIT:
        raise DataError(
            f"sample {int(off.argmax())} of a pose ends in no unit quaternion: its length is off "
            f"by {off.max():.3g} (tolerance {UNIT:g}; columns are {', '.join(POSE)})",
            sample=int(off.argmax()),
            tolerance=UNIT,
        )
    flips = np.where((turn[1:] * turn[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    signs = np.cumprod(np.append(1.0, flips))
    return np.concatenate([values[:, :3], signs[:, None] * turn], axis=1)


def require_known_motion(robot: Mechanism, free: Collection[str] = ()) -> None:
    """Refuse robots whose configuration does not follow from the motors and these free joints."""
    known = measurable(robot)
    for name in free:
        if name not in known:
            raise OptionError.unknown(f"free joint of {robot.name}", name, known)
    told = robot.coordinates_of(free)
    left = [name for name in robot.free if name not in told]
    if left:
        joints = [name for name in known if name not in free]
        advice = f", or measure {', '.join(joints)} ('free')" if joints else ""
        raise OptionError(
            f"a log of the motors does not tell where {', '.join(left)} of {robot.name} are, which "
            f"the motors leave free: lock them ({lock_options(robot, left)}){advice}",
            free=tuple(left),
            measurable=tuple(joints),
        )
    several = [name for name in robot.actuated if robot.joint(name).nv != 1]
    if several:
        raise OptionError(
            f"a log has one position a motor, but {', '.join(several)} of {robot.name} turn "
            "about several axes: name the motors in 'name_mot'",
            joints=tuple(several),
        )


def measurable(robot: Mechanism) -> tuple[str, ...]:
    """Free joints that sensors can tell: with one coordinate, or floating bases outside loops."""
    found = []
    for name in robot.joints:
        joint = robot.joint(name)
        own = slice(joint.idx_v, joint.idx_v + joint.nv)
        base = name in robot.floating and not robot.moving[:, own].any()
        if {*robot.coordinates_of([name])} <= {*robot.free} and (joint.nv == 1 or base):
            found.append(name)
    return tuple(found)


class FreeMotion(NamedTuple):
    """Free joints along a log; all other coordinates are zero, or as at the reference."""

    configurations: FloatArray  # (N, nq)
    velocities: FloatArray  # (N, nv)
    accelerations: FloatArray


def free_motion(robot: Mechanism, log: Log, free: Mapping[str, FloatArray]) -> FreeMotion:
    """Joints (N, k) of a log that no motor moves, filtered, and their derivatives."""
    q = np.tile(robot.reference, (len(log), 1))
    if not free:
        return FreeMotion(q, *np.zeros((2, len(log), robot.model.nv)))
    for name, values in free.items():
        _write(robot, name, q, values)
    steps = difference(robot, q[:-1], q[1:])
    way = np.concatenate([np.zeros((1, robot.model.nv)), np.cumsum(steps, axis=0)])
    v = log.by_part(differentiate, way)
    return FreeMotion(q, v, log.by_part(differentiate, v))


def _write(robot: Mechanism, name: str, q: FloatArray, values: FloatArray) -> None:
    """Put values (N, k) of a joint into configurations (N, nq), in place."""
    joint = robot.joint(name)
    samples(values, 1 if joint.nv == 1 else joint.nq, name)
    if joint.nv == 1:
        q[:] = JointCoordinates(robot, [name]).write(q, values)
        return
    turns = values[:, 3:] / np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    own = slice(joint.idx_q, joint.idx_q + joint.nq)
    q[:, own] = np.concatenate([values[:, :3], turns], axis=1)
