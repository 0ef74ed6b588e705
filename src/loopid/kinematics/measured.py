"""Measured coordinates, joints or the platform's, and the equations that give all others from them.

Steps and residuals are in common units (see ``constraint``).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray, samples
from loopid.errors import MobilityError, OptionError
from loopid.kinematics.constraint import Constraint, scaled_residual
from loopid.kinematics.poses import FramePoses, blocks, difference, frame_motions, frame_poses
from loopid.kinematics.projection import Factorisation, partition
from loopid.robot import Mechanism, Platform, relative_quaternion


class Linearisation(NamedTuple):
    """Residual (N, m) and its derivatives, exact where it is zero: Newton needs no more.

    By the unknown coordinates in unit steps (N, m, u), and by the measured values (N, m, c).
    """

    residual: FloatArray
    unknown: FloatArray
    known: FloatArray


class MeasuredCoordinates(ABC):
    """A set of numbers from which the configuration follows."""

    def __init__(self, mechanism: Mechanism, unknown: IntArray, width: int) -> None:
        self.mechanism = mechanism
        self.unknown = unknown
        self.width = width

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
        """Tangent vectors (N, nv) of scaled steps (N, u) of the unknown coordinates."""
        tangent = np.zeros((len(steps), self.mechanism.model.nv))
        tangent[:, self.unknown] = steps * self.mechanism.coordinate_scales[self.unknown]
        return tangent

    def steps(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        """Scaled steps (N, u) of the unknown coordinates between configurations (N, nq)."""
        tangent = difference(self.mechanism, origin, target)
        return tangent[:, self.unknown] / self.mechanism.coordinate_scales[self.unknown]


class JointCoordinates(MeasuredCoordinates):
    """Measured joints: the others are unknown, but for single coordinates that are independent.

    The spin of a rod in a spherical joint, or the placement of a floating base, is no number that
    could be given: it stays as it is at the start.
    """

    def __init__(self, mechanism: Mechanism, joints: Sequence[str]) -> None:
        self.known, _ = partition(mechanism, joints)
        if len(self.known) != len(joints):
            raise OptionError("only joints with one coordinate can be measured")
        held = mechanism.velocity_indices(mechanism.held)
        unknown = np.setdiff1d(np.arange(mechanism.model.nv), np.append(self.known, held))
        super().__init__(mechanism, unknown, len(joints))
        models = [mechanism.joint(name) for name in joints]
        self.first = np.array([joint.idx_q for joint in models], dtype=np.int64)
        # A continuous joint is stored as the cosine and sine of its angle.
        self.circular = np.array([joint.nq == 2 for joint in models], dtype=bool)

    def read(self, q: FloatArray) -> FloatArray:
        values = q[:, self.first]
        circle = self.first[self.circular]
        values[:, self.circular] = np.arctan2(q[:, circle + 1], q[:, circle])
        return values

    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        q = q.copy()
        q[:, self.first] = values
        angles, circle = values[:, self.circular], self.first[self.circular]
        q[:, circle], q[:, circle + 1] = np.cos(angles), np.sin(angles)
        return q

    def difference(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        way = target - origin
        turns = way[:, self.circular]
        way[:, self.circular] = np.mod(turns + np.pi, 2 * np.pi) - np.pi
        return way

    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        residual, jacobian = Constraint(self.mechanism, q).scaled()
        known = jacobian[:, :, self.known] / self.mechanism.coordinate_scales[self.known]
        return Linearisation(residual, jacobian[:, :, self.unknown], known)

    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        return scaled_residual(self.mechanism, q)


class PlatformCoordinates(MeasuredCoordinates):
    """A measured platform pose: all joints are unknown, the pose adds six equations."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.platform = declared_platform(mechanism)
        super().__init__(mechanism, np.arange(mechanism.model.nv), len(self.platform.motions))

    def read(self, q: FloatArray) -> FloatArray:
        return platform_coordinates(self.mechanism, q)

    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        return q.copy()

    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        residual, closures = Constraint(self.mechanism, q).scaled()
        frame = frame_poses(self.mechanism, q, [self.platform.frame_id])
        twist = np.repeat([1.0, self.mechanism.length], 3)[:, None]
        pose = np.concatenate([frame.linear[:, 0], frame.angular[:, 0]], axis=1)
        known = np.zeros((len(q), residual.shape[1] + 6, self.width))
        known[:, -6:] = -twist * self.platform.twist_map(values)
        return Linearisation(
            np.concatenate([residual, self._off_pose(frame, values)], 1),
            np.concatenate([closures, twist * pose * self.mechanism.coordinate_scales], 1),
            known,
        )

    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        frame = frame_poses(self.mechanism, q, [self.platform.frame_id], jacobians=False)
        return np.concatenate(
            [scaled_residual(self.mechanism, q), self._off_pose(frame, values)], 1
        )

    def _off_pose(self, frame: FramePoses, values: FloatArray) -> FloatArray:
        """What separates the frame from its target (N, 6), in m, along the fixed axes."""
        rotation, origin = self.platform.placements(values)
        inverses = np.swapaxes(frame.rotation[:, 0], 1, 2), np.swapaxes(rotation, 1, 2)
        turn = 2 * self.mechanism.length * relative_quaternion(*inverses)[0]
        return np.concatenate([frame.origin[:, 0] - origin, turn], 1)


@checked
def measured_coordinates(
    mechanism: Mechanism, coordinates: Sequence[str] | str | None = None
) -> MeasuredCoordinates:
    """Choose the measured coordinates: joints, ``"platform"``, or the independent joints.

    Raises
    ------
    MobilityError
        When they are too few or too many to determine the motion at the reference.
    """
    measured: MeasuredCoordinates
    if coordinates == "platform":
        measured = PlatformCoordinates(mechanism)
    else:
        names = mechanism.measured if coordinates is None else coordinates
        joints = (names,) if isinstance(names, str) else tuple(names)
        measured = JointCoordinates(mechanism, joints)
    q, unknown = mechanism.reference[None], len(measured.unknown)
    found = int(Factorisation.of(measured.linearise(q, measured.read(q)).unknown).rank[0])
    if found < unknown:
        raise MobilityError(
            f"the measured coordinates determine {found} of the {unknown} other coordinates of "
            f"{mechanism.name} at its reference: give more, or others, or a reference "
            "that is not singular"
        )
    jacobian, tolerance = Constraint(mechanism, q).scaled()[1], mechanism.closure_rank_tolerance
    if int(Factorisation.of(jacobian, tolerance).rank[0]) > found:
        raise MobilityError(
            f"the {measured.width} measured coordinates of {mechanism.name} are not "
            "independent of each other: leave some out"
        )
    return measured


@checked
def platform_coordinates(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Platform coordinates (N, c) that the robot file declares, at configurations (N, nq).

    Raises
    ------
    OptionError
        When the robot file declares none.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> loopid.platform_coordinates(robot, robot.reference).shape
    (1, 4)
    """
    platform = declared_platform(mechanism)
    q = samples(configurations, mechanism.model.nq, "configurations")
    frame = frame_poses(mechanism, q, [platform.frame_id], jacobians=False)
    return platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0])


def declared_platform(mechanism: Mechanism) -> Platform:
    """The platform of the robot file.

    Raises
    ------
    OptionError
        When the robot file declares none.
    """
    if mechanism.platform is None:
        raise OptionError(f"{mechanism.name} declares no platform coordinates")
    return mechanism.platform


@checked
def platform_motion(
    mechanism: Mechanism,
    configurations: FloatArray,
    rates: FloatArray,
    accelerations: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Velocities and accelerations (N, nv) of all joints from those of the platform coordinates.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    rates, accelerations : FloatArray
        (N, c), first and second derivatives of the platform coordinates by time.
    """
    platform = declared_platform(mechanism)
    q = samples(configurations, mechanism.model.nq, "configurations")
    xd = samples(rates, len(platform.motions), "platform rates", len(q))
    xdd = samples(accelerations, len(platform.motions), "platform accelerations", len(q))
    parts = [_platform_motion(mechanism, platform, q[k], xd[k], xdd[k]) for k in blocks(len(q))]
    v, a = zip(*parts, strict=True)
    return np.concatenate(v), np.concatenate(a)


def _platform_motion(
    mechanism: Mechanism, platform: Platform, q: FloatArray, xd: FloatArray, xdd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    constraint = Constraint(mechanism, q)
    frame = frame_poses(mechanism, q, [platform.frame_id])
    x = platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0])
    jacobian = [constraint.jacobian(), frame.linear[:, 0], frame.angular[:, 0]]
    scales, units = mechanism.coordinate_scales, np.repeat([1.0, mechanism.length], 3)
    rows = np.append(mechanism.row_scales, units)
    factors = Factorisation.of(rows[:, None] * np.concatenate(jacobian, axis=1) * scales)

    def solve(closures: FloatArray, twists: FloatArray) -> FloatArray:
        wanted = rows * np.concatenate([closures, twists], axis=1)
        return np.asarray(scales * factors.solve(wanted[:, :, None])[:, :, 0])

    E = platform.twist_map(x)
    v = solve(np.zeros((len(q), mechanism.rows)), np.einsum("nij,nj->ni", E, xd))
    moving = frame_motions(mechanism, q, v, frame)
    felt = np.concatenate([moving.acceleration[:, 0], moving.turning[:, 0]], axis=1)
    twist_rate = np.einsum("nij,nj->ni", E, xdd) + platform.twist_drift(x, xd)
    return v, solve(-constraint.drift(v), twist_rate - felt)
