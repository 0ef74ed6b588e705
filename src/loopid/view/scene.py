"""What is where when a robot with loops stands at a pose: numbers, without anything that draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray, checked, samples
from loopid.kinematics import measured_coordinates
from loopid.kinematics.assembly import largest_opening, try_assemble
from loopid.kinematics.closing import assembly_modes
from loopid.kinematics.constraint import scaled_residual
from loopid.kinematics.projection import singularity_measure
from loopid.records import record
from loopid.robot.robot import Robot

PARTS = 16  # of a way that leads out of reach: the robot goes as far as whole parts lead
APART = 0.01  # points of a link nearer to each other, in characteristic lengths, are one


@record
class Slider:
    """A joint that a hand moves, with all that follows from it."""

    joint: str
    unit: str
    low: float  # its limits, else half a turn, or half a length, to either side of the reference
    high: float


@record(checked="outside")
class ScenePose:
    """What is where at a configuration, in m along the fixed axes."""

    configuration: FloatArray  # (nq,)
    values: FloatArray  # of the sliders
    origins: FloatArray  # (joints + 1, 3), the fixed frame first
    rotations: FloatArray  # (joints + 1, 3, 3)
    joints: FloatArray  # (joints, 3), those that slide in their middle
    rods: FloatArray  # (rods, 2, 3), their ends
    closures: FloatArray  # (closures, 2, 3), the origins of the two frames of each
    open_by: FloatArray  # (closures,), the largest residual of each
    residual: float  # the largest one, of couplings too
    singularity: float  # see ``Projection.singularity``


@checked
class Scene:
    """A robot as it is drawn, and moved by the joints that determine where it is.

    Attributes
    ----------
    robot : Robot
    sliders : tuple of Slider
    closed : float
        Residual in m up to which a loop counts as closed.

    Raises
    ------
    MobilityError
        When the joints do not determine the motion at the reference.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> scene = loopid.view.Scene(robot)
    >>> pose, arrived = scene.moved(scene.at(robot.reference), [1.2, 1.9])
    >>> arrived, pose.values.round(6).tolist(), pose.residual < 1e-9
    (True, [1.2, 1.9], True)
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self._measured = robot, measured_coordinates(robot)
        at = self._measured.read(robot.reference[None])[0]
        self.sliders = tuple(map(self._slider, robot.measured, at))
        self.closed = largest_opening(robot)
        self._rods = link_rods(robot)

    def _slider(self, joint: str, at: float) -> Slider:
        reach = self.robot.length / 2 if self.robot.slides(joint) else np.pi
        low, high = np.where(np.isinf(self.robot.limits(joint)), (at - reach, at + reach),
                             self.robot.limits(joint))  # fmt: skip
        unit, _ = self.robot.units(joint)
        return Slider(joint, unit, float(min(low, at)), float(max(high, at)))

    def at(self, configuration: FloatArray) -> ScenePose:
        """What is where at a configuration (nq,), closed or not."""
        robot = self.robot
        q = samples(configuration, robot.model.nq, "configuration", 1)
        places, joints, rods, ends = placed(robot, self._rods, q[0])
        residual, owner = np.abs(scaled_residual(robot, q)[0]), robot.row_closures
        own = residual[: len(owner)]
        return ScenePose(
            configuration=q[0],
            values=self._measured.read(q)[0],
            origins=np.array([place.translation for place in places]),
            rotations=np.array([place.rotation for place in places]),
            joints=joints,
            rods=rods,
            closures=ends,
            open_by=np.array([own[owner == k].max() for k in range(len(robot.closures))]),
            residual=float(residual.max(initial=0.0)),
            singularity=float(singularity_measure(robot, q)[0]),
        )

    def moved(
        self, pose: ScenePose, values: FloatArray, *, part: float = 1.0
    ) -> tuple[ScenePose, bool]:
        """The closed pose at values of the sliders, and whether they are reached from a pose.

        The way there, or a part of it, is straight. It ends where it leaves the workspace or meets
        a singularity.
        """
        robot, start = self.robot, pose.configuration
        goal = samples(values, self._measured.width, "values", 1)
        way = part * self._measured.difference(pose.values[None], goal)
        found = try_assemble(robot, pose.values + way, start=start)
        if found.assembled[0]:
            return self.at(found.configurations[0]), True
        parts = pose.values + np.linspace(0.0, 1.0, PARTS + 1)[1:, None] * way
        found = try_assemble(robot, parts, start=start, trajectory=True)
        reached = int(np.append(found.assembled, False).argmin())
        return (self.at(found.configurations[reached - 1]) if reached else pose), False

    def modes(self) -> tuple[FloatArray, ...]:
        """The reference (nq,), and the other ways of assembling the robot there.

        Where the reference is singular, those a step of the motors away.
        """
        robot = self.robot
        found = robot.modes or (assembly_modes(robot, robot.reference) if robot.rows else ())
        others = (mode.reference for mode in found)
        return robot.reference, *(q for q in others if abs(q - robot.reference).max() > APART)


Rod = tuple[tuple[int, FloatArray], tuple[int, FloatArray]]  # joints, and points in their frames


def link_rods(robot: Robot) -> list[Rod]:
    """Rods that stand for links: a star through the joints of each, and how far slides are out."""
    model, origin = robot.model, np.zeros(3)
    rods, points = list[Rod](), [list[FloatArray](), *([origin] for _ in robot.joints)]
    for k in range(1, model.njoints):
        points[model.parents[k]].append(model.jointPlacements[k].translation)
    for frame in (model.frames[k] for k in robot.closure_frames[0]):
        points[frame.parentJoint].append(frame.placement.translation)
    for k, found in enumerate(points):
        if len(found) == 1 and k:  # the end of a chain
            found.append(model.inertias[k].lever)
        middle = np.mean(found, axis=0) if len(found) > 2 else found[0] if found else origin
        for point in found:
            if np.linalg.norm(point - middle) > APART * robot.length:
                rods.append(((k, middle), (k, point)))
    for k in sorted({robot.joint_ids[index] for index in robot.prismatic}):
        if model.joints[k].nv == 1:
            rods.append(((model.parents[k], model.jointPlacements[k].translation), (k, origin)))
    return rods


def slides(rods: Sequence[Rod]) -> dict[int, int]:
    """Joints that slide to the rods that show how far they are out."""
    return {joint: k for k, ((base, _), (joint, _)) in enumerate(rods) if base != joint}


def placed(
    robot: Robot, rods: Sequence[Rod], configuration: FloatArray
) -> tuple[list[pin.SE3], FloatArray, FloatArray, FloatArray]:
    """Frames of joints; where joints (joints, 3), rods (R, 2, 3) and closures (closures, 2, 3) are.

    A joint that slides is in the middle of its rod: at its ends are other joints.
    """
    data = robot.memory.data
    pin.framesForwardKinematics(robot.model, data, configuration)
    places, frames = list(data.oMi), [data.oMf[k].translation for k in robot.closure_frames[0]]
    points = [places[joint].act(point) for rod in rods for joint, point in rod]
    joints, ends = (
        np.array([place.translation for place in places[1:]]),
        np.reshape(points, (-1, 2, 3)),
    )
    for joint, rod in slides(rods).items():
        joints[joint - 1] = ends[rod].mean(axis=0)
    return places, joints, ends, np.reshape(frames, (-1, 2, 3))
