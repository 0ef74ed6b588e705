"""Why coordinates are free of the motors: a sentence for each cause."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arguments import BoolArray, FloatArray
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.poses import frame_poses
from loopid.kinematics.projection import Factorisation, null_space
from loopid.robot.robot import Robot, link_frames, lock_options, shortened

SPRING = "Ks"
# Part of the fastest coordinate, or body, of a motion that is none: files are rounded.
STANDS = 1e-3
ALONG = 0.02  # rad between the axis of a joint and the line of a spin: they are drawn so


def why_free(robot: Robot, around: FloatArray) -> list[str]:
    """What the motors leave free, a sentence a cause; ``around`` (n, nq) are configurations."""
    floating = robot.coordinates_of(robot.floating)
    free = [name for name in robot.free if name not in floating]
    if not free:
        return []
    q, motions = _motions(robot, around, free)
    causes, springs = dict[str, list[str]](), dict[str, None]()
    for name, motion in zip(free, motions, strict=True):
        stirred = np.abs(motion) > STANDS * np.abs(motion).max(initial=0.0)
        moving = [robot.coordinates[k] for k in np.flatnonzero(stirred)]
        sprung = [k for k in moving if robot.joint_values.get(k, {}).get(SPRING)]
        cause = SPRUNG if sprung else SPUN if _is_spin(robot, q, motion) else UNKNOWN
        causes.setdefault(cause, []).append(name)
        springs |= dict.fromkeys(sprung if cause == SPRUNG else ())
    file = robot.path is not None
    facts = {
        "closures": "'closures' of a YAML beside the file" if file else "closures=[Closure(...)]",
        "springs": shortened([*springs]),
        "lock": lock_options(robot, causes.get(SPUN, ())),
    }
    return [
        f"the motors leave {shortened(names)} free{cause.format(**facts)}"
        for cause, names in causes.items()
    ]


SPRUNG = ', but springs of {springs} hold what moves there: terms="file" has their forces'
SPUN = (
    ", the spin of a rod between its ends, which moves nothing else and is harmless: {lock} takes "
    "its row '= 0' out"
)
UNKNOWN = (
    ": no force acts there, and rows '= 0' say so; lock what does not move, and write what moves "
    "with a loop into {closures}"
)


def _motions(
    robot: Robot, around: FloatArray, free: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """A regular configuration (nq,), and motions (k, nv) of a free coordinate each, in units."""
    jacobians, tolerance = Constraint(robot, around).scaled()[1], robot.closure_rank_tolerance
    regular = int(Factorisation.of(jacobians, tolerance).rank.argmax()) if robot.rows else 0
    # The last of these, as the reference itself may be special.
    motions = np.zeros((len(free), robot.model.nv))
    for motion, name in zip(motions, free, strict=True):
        others = robot.velocity_indices(k for k in robot.independent if k != name)
        rest = np.setdiff1d(np.arange(robot.model.nv), others)
        space = null_space(jacobians[regular][:, rest], tolerance)
        own = space[list(rest).index(int(robot.velocity_indices([name])[0]))]
        motion[rest] = space @ own
    return around[regular], motions


def _is_spin(robot: Robot, q: FloatArray, motion: FloatArray) -> bool:
    """Whether all that a motion (nv,) moves turns as one about a line, with a hold at either end.

    A rod that spins between two balls does, and a pin between two hinges. So do halves of a rod
    that a closure welds. Nothing else hangs on it, and its centre of mass is on the line: otherwise
    gravity turns it. Joints turn about that line only: locked, they hold nothing but the spin.
    """
    frames, model = link_frames(robot.model), robot.model
    poses = frame_poses(robot, q[None], [frames[link] for link in robot.links])
    rates = poses.joint_jacobian[0] * motion * robot.coordinate_scales
    twists = (rates @ poses.supports.T).T / np.array([robot.length] * 3 + [1.0] * 3)
    sizes = np.linalg.norm(twists, axis=1)
    moved = sizes > STANDS * sizes.max(initial=0.0)
    if not moved.any() or _holds(robot, motion, moved) != 2:
        return False
    linear, angular = twists[moved][0].reshape(2, 3)
    turn = np.linalg.norm(angular)
    alike = np.abs(twists[moved] - twists[moved][0]).max() <= STANDS * sizes.max()
    about_a_line = turn > 0 and abs(linear @ angular) <= STANDS * sizes.max() * turn
    axes = rates[3:, np.abs(motion) > STANDS * np.abs(motion).max()]
    across = np.cross(axes, angular, axis=0, axisb=0, axisc=0)
    along = np.abs(across).max() <= ALONG * turn * np.linalg.norm(axes, axis=0).max()
    weight, moment = 0.0, np.zeros(3)
    for k in np.flatnonzero(moved):
        frame = model.frames[frames[robot.links[k]]]
        inertia = model.inertias[frame.parentJoint]
        lever = frame.placement.actInv(inertia.lever)
        weight += inertia.mass
        moment += inertia.mass * (poses.origin[0, k] + poses.rotation[0, k] @ lever)
    # Speed of the centre of mass over that of the turn: its distance from the line.
    centre = moment / (weight * robot.length) if weight > 0 else np.zeros(3)
    swings = weight > 0 and np.linalg.norm(linear + np.cross(angular, centre)) > STANDS * turn
    return bool(alike and about_a_line and along and not swings)


def _holds(robot: Robot, motion: FloatArray, moved: BoolArray) -> int:
    """How many joints and closures join the bodies that a motion (nv,) moves to others."""
    joints = [body.joint_id for body in robot.bodies]
    moving = dict(zip(joints, moved, strict=True)) | {0: False}
    count = 0
    for joint in joints:
        carrier = robot.model.parents[joint]
        while carrier not in moving:
            carrier = robot.model.parents[carrier]
        count += moving[carrier] != moving[joint]
    _, supports = robot.closure_frames
    held = (supports & (np.abs(motion) > STANDS * np.abs(motion).max())).any(axis=1)
    return int(count + (held[::2] != held[1::2]).sum())
