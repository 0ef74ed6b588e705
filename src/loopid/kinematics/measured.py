"""Coordinates that are measured, and the equations that give all the others.

Joints or platform coordinates: either way a set of numbers that determines the motion. Steps
and residuals are in common units (see ``scaling``).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import MobilityError, OptionError
from loopid.kinematics.constraint import constraint_values
from loopid.kinematics.frames import frame_kinematics
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.pairs import relative_quaternion
from loopid.kinematics.platform import declared_platform, platform_coordinates
from loopid.kinematics.projection import partition
from loopid.kinematics.scaling import coordinate_scales, row_scales, scaled_jacobian
from loopid.mechanism import Mechanism


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
    def equations(self, q: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residual (N, m) and its derivative (N, m, u) by the unknown coordinates.

        The derivative is exact where the residual is zero, which is all that Newton's method needs.
        """

    def difference(self, origin: FloatArray, target: FloatArray) -> FloatArray:
        """The way (N, width) from values to values."""
        return target - origin

    def tangent(self, steps: FloatArray) -> FloatArray:
        """Tangent vectors (N, nv) of scaled steps (N, u) of the unknown coordinates."""
        tangent = np.zeros((len(steps), self.mechanism.model.nv))
        tangent[:, self.unknown] = steps * coordinate_scales(self.mechanism)[self.unknown]
        return tangent

    def closure_gap(self, q: FloatArray, values: FloatArray) -> FloatArray:
        """Largest residual (N,) in m."""
        residual, _ = self.equations(q, values)
        return np.asarray(np.abs(residual).max(axis=1, initial=0.0), dtype=np.float64)


class JointCoordinates(MeasuredCoordinates):
    """Measured joints: the others are unknown, but for single coordinates that are independent.

    The spin of a rod in a spherical joint, or the placement of a floating base, is no number that
    could be given: it stays as it is at the start.
    """

    def __init__(self, mechanism: Mechanism, joints: Sequence[str]) -> None:
        known, _ = partition(mechanism, joints)
        if len(known) != len(joints):
            raise OptionError("only joints with one coordinate can be measured")
        held = mechanism.velocity_indices(mechanism.held)
        unknown = np.setdiff1d(np.arange(mechanism.model.nv), np.append(known, held))
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
        shortest = np.mod(way + np.pi, 2 * np.pi) - np.pi
        return np.where(self.circular, shortest, way)

    def equations(self, q: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        residual, jacobian = scaled_constraint(self.mechanism, q)
        return residual, jacobian[:, :, self.unknown]


class PlatformCoordinates(MeasuredCoordinates):
    """A measured platform pose: all joints are unknown, the pose adds six equations."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.platform = declared_platform(mechanism)
        everything = np.arange(mechanism.model.nv)
        super().__init__(mechanism, everything, len(self.platform.motions))

    def read(self, q: FloatArray) -> FloatArray:
        return platform_coordinates(self.mechanism, q)

    def write(self, q: FloatArray, values: FloatArray) -> FloatArray:
        return q.copy()

    def equations(self, q: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        residual, jacobian = scaled_constraint(self.mechanism, q)
        pose, pose_jacobian = self._pose_equations(q, values)
        return np.concatenate([residual, pose], 1), np.concatenate([jacobian, pose_jacobian], 1)

    def _pose_equations(self, q: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        rotation, origin = self.platform.placements(values)
        frame = frame_kinematics(self.mechanism, q, [self.platform.frame_id])
        # The turn that separates the frame from its target, along the fixed axes like its rate.
        inverses = np.swapaxes(frame.rotation[:, 0], 1, 2), np.swapaxes(rotation, 1, 2)
        vector, _ = relative_quaternion(*inverses)
        length = self.mechanism.length
        residual = np.concatenate([frame.origin[:, 0] - origin, 2 * length * vector], 1)
        jacobian = frame.jacobian[:, 0] * coordinate_scales(self.mechanism)
        jacobian[:, 3:] *= length
        return residual, jacobian


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
    _refuse_insufficient(measured)
    return measured


def scaled_constraint(mechanism: Mechanism, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Closure residual (N, rows) in m and Jacobian (N, rows, nv) in m per unit step."""
    values = constraint_values(mechanism, q)
    residual = values.residual * row_scales(mechanism)
    return residual, scaled_jacobian(mechanism, values.jacobian)


def _refuse_insufficient(measured: MeasuredCoordinates) -> None:
    q = measured.mechanism.reference[None]
    _, jacobian = measured.equations(q, measured.read(q))
    found, unknown = int(Factorisation.of(jacobian).rank[0]), len(measured.unknown)
    if found < unknown:
        raise MobilityError(
            f"the measured coordinates determine {found} of the {unknown} other coordinates of "
            f"{measured.mechanism.name} at its reference: give more, or others, or a reference "
            "that is not singular"
        )
    _, closure = scaled_constraint(measured.mechanism, q)
    if int(Factorisation.of(closure).rank[0]) > found:
        raise MobilityError(
            f"the {measured.width} measured coordinates of {measured.mechanism.name} are not "
            "independent of each other: leave some out"
        )
