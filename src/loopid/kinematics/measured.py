"""Measured coordinates: joints, or those of the platform, from which all others follow.

The platform at coordinates x has the twist t = E ẋ, and the Jacobian J_p by all joints. So E ẋ =
J_p G u̇, and the platform Jacobian is E⁺ J_p G.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked, one_as_many, samples
from loopid.errors import MobilityError, OptionError
from loopid.kinematics.constraint import Constraint, scaled_residual
from loopid.kinematics.poses import FramePoses, blocks, difference, frame_motions, frame_poses
from loopid.kinematics.projection import Factorisation, partition
from loopid.records import derived
from loopid.robot.closures import relative_quaternion
from loopid.robot.platform import Platform
from loopid.robot.robot import Robot


class Linearisation(NamedTuple):
    """Residual and its derivatives, exact where it is zero: Newton needs no more."""

    residual: FloatArray  # (N, m)
    unknown: FloatArray  # (N, m, u), by the unknown coordinates in unit steps
    known: FloatArray  # (N, m, c), by the measured values


class MeasuredCoordinates(ABC):
    """Numbers that give the configuration; steps of the others in rad or lengths of the robot."""

    def __init__(self, robot: Robot, unknown: IntArray, width: int) -> None:
        self.robot = robot
        self.unknown = unknown
        self.width = width
        self.scales = robot.coordinate_scales[unknown]

    @abstractmethod
    def read(self, q: FloatArray) -> FloatArray:
        """Their values (N, width) at configurations (N, nq)."""

    @abstractmethod
    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Configurations with the measured values put in, as far as they are coordinates."""

    @abstractmethod
    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        """The equations at configurations (N, nq) that should have values (N, width)."""

    @abstractmethod
    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Residual (N, m) alone."""

    def difference(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        """The way (N, width) from values to values."""
        return target - origin

    def tangent(self, steps: FloatArray) -> FloatArray:
        """Tangent vectors (N, nv) of steps (N, u) of the unknown coordinates."""
        tangent = np.zeros((len(steps), self.robot.model.nv))
        tangent[:, self.unknown] = steps * self.scales
        return tangent

    def steps(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        """Steps (N, u) of the unknown coordinates between configurations (N, nq)."""
        return difference(self.robot, origin, target)[:, self.unknown] / self.scales


class JointCoordinates(MeasuredCoordinates):
    """Measured joints: the others are unknown, but for single coordinates that are independent.

    The spin of a rod in a spherical joint, or the placement of a floating base, is no number that
    could be given. It stays as it is at the start.
    """

    def __init__(self, robot: Robot, joints: Sequence[str]) -> None:
        self.known, _ = partition(robot, joints)
        if len(self.known) != len(joints):
            raise OptionError("only joints with one coordinate can be measured", given=joints)
        held = robot.velocity_indices(robot.unmeasured)
        unknown = np.setdiff1d(np.arange(robot.model.nv), np.append(self.known, held))
        super().__init__(robot, unknown, len(joints))
        self.known_scales = robot.coordinate_scales[self.known]
        models = [robot.joint(name) for name in joints]
        self.first = np.array([joint.idx_q for joint in models], dtype=np.int64)
        # A continuous joint is stored as the cosine and sine of its angle.
        self.circular = np.array([joint.nq == 2 for joint in models], dtype=bool)
        self.circles = self.first[self.circular]

    def read(self, q: FloatArray) -> FloatArray:
        values = q[:, self.first]
        if len(self.circles):
            values[:, self.circular] = np.arctan2(q[:, self.circles + 1], q[:, self.circles])
        return values

    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        q = q.copy()
        q[:, self.first] = values
        if len(self.circles):
            angles = values[:, self.circular]
            q[:, self.circles], q[:, self.circles + 1] = np.cos(angles), np.sin(angles)
        return q

    def difference(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        way = target - origin
        if len(self.circles):
            way[:, self.circular] = np.mod(way[:, self.circular] + np.pi, 2 * np.pi) - np.pi
        return way

    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        residual, jacobian = Constraint(self.robot, q).scaled()
        known = jacobian.take(self.known, axis=2) / self.known_scales
        return Linearisation(residual, jacobian.take(self.unknown, axis=2), known)

    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        return scaled_residual(self.robot, q)


class PlatformCoordinates(MeasuredCoordinates):
    """A measured platform pose: all joints are unknown, the pose adds six equations."""

    def __init__(self, robot: Robot) -> None:
        self.platform = declared_platform(robot)
        super().__init__(robot, np.arange(robot.model.nv), len(self.platform.motions))

    def read(self, q: FloatArray) -> FloatArray:
        return coordinates_at(self.robot, q)

    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        return q.copy()

    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        residual, closures = Constraint(self.robot, q).scaled()
        frame = frame_poses(self.robot, q, [self.platform.frame_id])
        twist = np.repeat([1.0, self.robot.length], 3)[:, None]
        known = np.zeros((len(q), residual.shape[1] + 6, self.width))
        known[:, -6:] = -twist * self.platform.twist_map(values)
        return Linearisation(
            np.concatenate([residual, self._off_pose(frame, values)], 1),
            np.concatenate([closures, twist * frame.twists * self.robot.coordinate_scales], 1),
            known,
        )

    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        frame = frame_poses(self.robot, q, [self.platform.frame_id], jacobians=False)
        return np.concatenate([scaled_residual(self.robot, q), self._off_pose(frame, values)], 1)

    def _off_pose(self, frame: FramePoses, values: FloatArray) -> FloatArray:
        """What separates the frame from its target (N, 6), in m, along the fixed axes."""
        rotation, origin = self.platform.placements(values)
        inverses = np.swapaxes(frame.rotation[:, 0], 1, 2), np.swapaxes(rotation, 1, 2)
        turn = 2 * self.robot.length * relative_quaternion(*inverses)[0]
        return np.concatenate([frame.origin[:, 0] - origin, turn], 1)


@checked
def measured_coordinates(
    robot: Robot, coordinates: Sequence[str] | str | None = None
) -> MeasuredCoordinates:
    """Choose the measured coordinates: joints, ``"platform"``, or the independent joints.

    They are made once for a robot and a choice.

    Parameters
    ----------
    robot : Robot
    coordinates : str or sequence of str, optional

    Returns
    -------
    MeasuredCoordinates
        Which reads them from configurations, and writes them there.

    Raises
    ------
    MobilityError
        When they are too few or too many to determine the motion at the reference.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> loopid.kinematics.measured_coordinates(robot).read(robot.reference[None]).shape
    (1, 2)
    """
    key = coordinates if isinstance(coordinates, str | None) else tuple(coordinates)
    return _determining(robot, key)


@derived
def _determining(robot: Robot, coordinates: tuple[str, ...] | str | None) -> MeasuredCoordinates:
    measured: MeasuredCoordinates
    if coordinates == "platform":
        measured = PlatformCoordinates(robot)
    else:
        names = robot.measured if coordinates is None else coordinates
        measured = JointCoordinates(robot, (names,) if isinstance(names, str) else names)
    q, unknown = robot.reference[None], len(measured.unknown)
    found = int(Factorisation.of(measured.linearise(q, measured.read(q)).unknown).rank[0])
    if found < unknown:
        raise MobilityError(
            f"the measured coordinates determine {found} of the {unknown} other coordinates of "
            f"{robot.name} at its reference: give more, or others, or a reference "
            "that is not singular",
            determined=found,
            unknown=unknown,
        )
    jacobian, tolerance = Constraint(robot, q).scaled()[1], robot.closure_rank_tolerance
    if int(Factorisation.of(jacobian, tolerance).rank[0]) > found:
        raise MobilityError(
            f"the {measured.width} measured coordinates of {robot.name} are not "
            "independent of each other: leave some out",
            measured=measured.width,
        )
    return measured


def declared_platform(robot: Robot) -> Platform:
    """The platform of the robot file; an OptionError when it declares none."""
    if robot.platform is None:
        raise OptionError(f"{robot.name} declares no platform coordinates", robot=robot.name)
    return robot.platform


@checked
@one_as_many
def platform_coordinates(robot: Robot, configurations: FloatArray) -> FloatArray:
    """Platform coordinates that the robot file declares.

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (nq,) or (N, nq).

    Returns
    -------
    FloatArray
        (c,) or (N, c), in m or rad.

    Raises
    ------
    OptionError
        When the robot file declares none.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("3ups_rpu")
    >>> loopid.kinematics.platform_coordinates(robot, robot.reference).shape
    (4,)
    """
    return coordinates_at(robot, samples(configurations, robot.model.nq, "configurations"))


def coordinates_at(robot: Robot, q: FloatArray) -> FloatArray:
    """As ``platform_coordinates``, at configurations that are checked."""
    platform = declared_platform(robot)
    frame = frame_poses(robot, q, [platform.frame_id], jacobians=False)
    return platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0])


def platform_jacobian(robot: Robot, q: FloatArray, G: FloatArray) -> FloatArray:
    """Rates (N, c, dof) of the platform by the independent coordinates; G is (N, nv, dof)."""
    platform = declared_platform(robot)
    frame = frame_poses(robot, q, [platform.frame_id])
    units = np.repeat([1.0, robot.length], 3)[:, None]
    E = platform.twist_map(platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0]))
    lengths = np.where([motion.startswith("r") for motion in platform.motions], 1.0, units[-1])
    factors = Factorisation.of(units * E * lengths)
    return np.asarray(lengths[:, None] * factors.solve(units * (frame.twists @ G)))


@checked
def platform_motion(
    robot: Robot, configurations: FloatArray, rates: FloatArray, accelerations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Velocities and accelerations (N, nv) of all joints from those (N, c) of the platform."""
    platform = declared_platform(robot)
    q = samples(configurations, robot.model.nq, "configurations")
    xd = samples(rates, len(platform.motions), "platform rates", len(q))
    xdd = samples(accelerations, len(platform.motions), "platform accelerations", len(q))
    parts = [_platform_motion(robot, platform, q[k], xd[k], xdd[k]) for k in blocks(len(q))]
    v, a = zip(*parts, strict=True)
    return np.concatenate(v), np.concatenate(a)


def _platform_motion(
    robot: Robot, platform: Platform, q: FloatArray, xd: FloatArray, xdd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    constraint = Constraint(robot, q)
    frame = frame_poses(robot, q, [platform.frame_id])
    x = platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0])
    scales, units = robot.coordinate_scales, np.repeat([1.0, robot.length], 3)
    rows = np.append(robot.row_scales, units)
    jacobian = np.concatenate([constraint.jacobian(), frame.twists], axis=1)
    factors = Factorisation.of(rows[:, None] * jacobian * scales)

    def solve(closures: FloatArray, twists: FloatArray) -> FloatArray:
        wanted = rows * np.concatenate([closures, twists], axis=1)
        return np.asarray(scales * factors.solve(wanted[:, :, None])[:, :, 0])

    E = platform.twist_map(x)
    v = solve(np.zeros((len(q), robot.rows)), np.einsum("nij,nj->ni", E, xd))
    moving = frame_motions(robot, q, v, frame)
    drift = np.concatenate([moving.acceleration[:, 0], moving.turning[:, 0]], axis=1)
    twist_rate = np.einsum("nij,nj->ni", E, xdd) + platform.twist_drift(x, xd)
    return v, solve(-constraint.drift(v), twist_rate - drift)
