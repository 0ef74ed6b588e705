"""Joints as measured coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.kinematics.dependent import elimination_for
from loopid.kinematics.elimination import Elimination
from loopid.kinematics.equations import (
    Linearisation,
    MeasuredCoordinates,
    scaled_constraint,
    scaled_residual,
)
from loopid.kinematics.projection import partition
from loopid.kinematics.scaling import coordinate_scales
from loopid.robot import Mechanism


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

    @property
    def elimination(self) -> Elimination | None:
        return elimination_for(self.mechanism, self.unknown)

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
        residual, jacobian = scaled_constraint(self.mechanism, q)
        known = jacobian[:, :, self.known] / coordinate_scales(self.mechanism)[self.known]
        return Linearisation(residual, jacobian[:, :, self.unknown], known)

    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        return scaled_residual(self.mechanism, q)
