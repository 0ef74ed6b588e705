"""The platform's pose as measured coordinates."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.equations import (
    Linearisation,
    MeasuredCoordinates,
    scaled_constraint,
    scaled_residual,
)
from loopid.kinematics.frames import FrameKinematics, frame_kinematics
from loopid.kinematics.pairs import relative_quaternion
from loopid.kinematics.platform import declared_platform, platform_coordinates
from loopid.kinematics.scaling import coordinate_scales
from loopid.robot import Mechanism


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

    def linearise(self, q: FloatArray, values: FloatArray) -> Linearisation:
        residual, closures = scaled_constraint(self.mechanism, q)
        frame = self._frame(q)
        twist = np.concatenate([np.ones(3), np.full(3, self.mechanism.length)])[:, None]
        pose = twist * frame.jacobian[:, 0] * coordinate_scales(self.mechanism)
        known = np.zeros((len(q), residual.shape[1] + 6, self.width))
        known[:, -6:] = -twist * self.platform.twist_map(values)
        return Linearisation(
            np.concatenate([residual, self._off_pose(frame, values)], 1),
            np.concatenate([closures, pose], 1),
            known,
        )

    def residual(self, q: FloatArray, values: FloatArray) -> FloatArray:
        off = self._off_pose(self._frame(q), values)
        return np.concatenate([scaled_residual(self.mechanism, q), off], 1)

    def _frame(self, q: FloatArray) -> FrameKinematics:
        return frame_kinematics(self.mechanism, q, [self.platform.frame_id])

    def _off_pose(self, frame: FrameKinematics, values: FloatArray) -> FloatArray:
        """What separates the frame from its target (N, 6), in m, along the fixed axes."""
        rotation, origin = self.platform.placements(values)
        inverses = np.swapaxes(frame.rotation[:, 0], 1, 2), np.swapaxes(rotation, 1, 2)
        vector, _ = relative_quaternion(*inverses)
        turn = 2 * self.mechanism.length * vector
        return np.concatenate([frame.origin[:, 0] - origin, turn], 1)
