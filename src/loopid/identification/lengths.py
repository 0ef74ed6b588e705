"""What lengths of the robot file that are off, or zeros of motors, would do to the forces.

Bodies take up most of it, as a link that is longer moves a body further, and one that is turned has
its centre of mass elsewhere. What is left gives the length, or the zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray
from loopid.identification.force_models import ForceModel
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.poses import integrate
from loopid.kinematics.projection import Factorisation, closed_motion, partition
from loopid.logs.recording import Recording
from loopid.regressors.motion_regressors import motion_regressor
from loopid.robot.robot import Robot

PART = 1e-4  # by which a length is changed, for its derivative
LEAST = 1e-6  # of the forces, and of the robot's length: less is none


class Place(NamedTuple):
    """The joint or frame at the end of a length, or a motor with a zero in a unit."""

    name: str
    unit: str = ""


def length_forces(
    force_model: ForceModel, standard: FloatArray, recordings: Sequence[Recording]
) -> dict[Place, FloatArray]:
    """Forces (N, dof) per part of each length that makes some, and per rad or m of each zero.

    None of a robot with coordinates that motors leave free: these were measured. ``standard`` are
    parameters of the force model that begin with those of the bodies.
    """
    robot = force_model.robot
    if robot.free:
        return {}
    bodies = standard[: len(force_model.base.parameters) - len(force_model.joint_values)]

    def forces(other: Robot) -> FloatArray:
        parts = [_forces(other, run, force_model.model) @ bodies for run in recordings]
        return np.concatenate(parts)

    usual, found = forces(robot), dict[Place, FloatArray]()
    for place, other in chain(_changed(robot), _turned(robot)):
        column = (forces(other) - usual) / PART
        if np.linalg.norm(column) > LEAST * np.linalg.norm(usual):
            found[place] = column
    return found


def _changed(robot: Robot) -> Iterator[tuple[Place, Robot]]:
    """The robot with each length that is not zero changed: to a joint, or a frame of a closure."""
    ends = sorted({frame for closure in robot.closures for frame in closure.frame_ids})
    joints = range(1, robot.model.njoints)
    places: list[tuple[str, Callable[[pin.Model], pin.SE3]]] = [
        *((robot.model.names[k], lambda model, k=k: model.jointPlacements[k]) for k in joints),
        *((robot.model.frames[k].name, lambda model, k=k: model.frames[k].placement) for k in ends),
    ]
    for name, placement in places:
        model = robot.model.copy()
        place = placement(model)
        if np.linalg.norm(place.translation) > LEAST * robot.length:
            place.translation = (1 + PART) * place.translation
            yield Place(name), replace(robot, model=model)


def _turned(robot: Robot) -> Iterator[tuple[Place, Robot]]:
    """The robot at positions that are less, of each motor with one coordinate."""
    for name in robot.actuated:
        model, joint = robot.model.copy(), robot.joint(name)
        if joint.nv == 1:
            data, neutral = joint.createData(), pin.neutral(model)
            joint.calc(data, neutral[joint.idx_q : joint.idx_q + joint.nq])
            place = model.jointPlacements[joint.id]
            model.jointPlacements[joint.id] = place * pin.exp6(pin.Motion(-PART * np.ravel(data.S)))
            yield Place(name, robot.units(name)[0]), replace(robot, model=model)


def _forces(robot: Robot, run: Recording, model: str) -> FloatArray:
    """Regressor (N, dof, n) of a motion of motors, with the loops closed as they nearly are."""
    motion, q = run.motion, run.motion.configurations
    if robot.rows:
        dependent = partition(robot)[1]
        open_by, A = Constraint(robot, q).scaled()
        step = np.zeros((len(q), robot.model.nv))
        solved = Factorisation.of(A[:, :, dependent]).solve(open_by[:, :, None])
        step[:, dependent] = -solved[:, :, 0]
        q = integrate(robot, q, step * robot.coordinate_scales)
    whole = closed_motion(robot, q, motion.velocities, motion.accelerations)
    return motion_regressor(robot, whole, model)
