"""Forces in the joints themselves: drive inertia, friction and offset, actuated or passive.

For joint j with rate q̇ the columns are q̈ (Ia), sign q̇ (Fc), q̇ (Fv) and 1 (Fo); the actuated
joints feel them through Gᵀ [Khalil2004, ch. 12].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.kinematics.motion import ClosedMotion
from loopid.parameters import Parameter, ParameterSet
from loopid.robot import Mechanism

# Units for a sliding and for a turning joint.
JOINT_KINDS = {
    "Ia": ("kg", "kg m²"),
    "Fc": ("N", "N m"),
    "Fv": ("N s/m", "N m s/rad"),
    "Fo": ("N", "N m"),
}


@checked_fields
@dataclass(frozen=True)
class JointTerms:
    """Which joints have which terms.

    Attributes
    ----------
    joints : tuple of str
        Joints with one coordinate, actuated or passive.
    kinds : tuple of str
        ``"Ia"`` drive inertia, ``"Fc"`` Coulomb and ``"Fv"`` viscous friction, ``"Fo"`` offset.
    dead_zone : float
        Rate (m/s or rad/s) up to which a joint counts as standing: no Coulomb friction.
    smoothing : float
        Rate over which the sign of the rate is smoothed, tanh(q̇ / smoothing); 0 for none.
    """

    joints: tuple[str, ...]
    kinds: tuple[str, ...] = ("Fc", "Fv")
    dead_zone: float = 0.0
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        for kind in self.kinds:
            if kind not in JOINT_KINDS:
                raise OptionError.unknown("joint term", kind, JOINT_KINDS)
        for name in ("dead_zone", "smoothing"):
            if not 0 <= getattr(self, name) < np.inf:
                raise OptionError(f"{name} must be a rate from 0 on, not {getattr(self, name)}")

    def parameters(self, mechanism: Mechanism) -> ParameterSet:
        """Labels ``<joint>.<kind>``, joint by joint; the names of ``columns``."""
        return ParameterSet(
            tuple(
                Parameter(joint, kind, JOINT_KINDS[kind][index not in mechanism.prismatic])
                for joint in self.joints
                for index in (self._index(mechanism, joint),)
                for kind in self.kinds
            )
        )

    def columns(self, mechanism: Mechanism, motion: ClosedMotion) -> FloatArray:
        """Actuator forces (N, dof, k) per unit of each of ``parameters``."""
        parts = []
        for joint in self.joints:
            index = self._index(mechanism, joint)
            rate, acceleration = motion.velocities[:, index], motion.accelerations[:, index]
            signals = np.stack([self._signal(kind, rate, acceleration) for kind in self.kinds], 1)
            parts.append(motion.projection.G[:, index, :, None] * signals[:, None, :])
        return np.concatenate(parts, axis=2)

    def _index(self, mechanism: Mechanism, joint: str) -> int:
        indices = mechanism.velocity_indices([joint])
        if len(indices) != 1:
            raise OptionError(f"joint {joint} has {len(indices)} coordinates, terms need one")
        return int(indices[0])

    def _signal(self, kind: str, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        if kind == "Ia":
            return acceleration
        if kind == "Fv":
            return rate
        return np.ones_like(rate) if kind == "Fo" else self._direction(rate)

    def _direction(self, rate: FloatArray) -> FloatArray:
        direction = np.tanh(rate / self.smoothing) if self.smoothing else np.sign(rate)
        return np.where(np.abs(rate) > self.dead_zone, direction, 0.0)
