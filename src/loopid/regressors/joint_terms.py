"""Forces in the joints themselves: drive inertia, friction and offset, actuated or passive.

Each term is one class with its law, units and sign; ``JOINT_TERMS`` is the registry. The force in
joint j is a coefficient times the term's signal, such as q̈ or sign q̇; the actuated joints feel it
through Gᵀ [Khalil2004, ch. 12].
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.kinematics import ClosedMotion
from loopid.parameters import Parameter, ParameterSet
from loopid.robot import Mechanism


class JointState(NamedTuple):
    """Position, rate and acceleration of a joint: arrays (N,), or CasADi expressions."""

    position: Any
    rate: Any
    acceleration: Any


class JointTerm(ABC):
    """A kind of force in a joint.

    Attributes
    ----------
    units : tuple of str
        Of the coefficient, for a sliding and for a turning joint.
    """

    units: ClassVar[tuple[str, str]]

    @staticmethod
    @abstractmethod
    def signal(joint: JointState, terms: JointTerms, math: Any) -> Any:
        """What the coefficient multiplies; ``math`` is NumPy, or CasADi for exported C code."""


class DriveInertia(JointTerm):
    """Ia q̈: rotor and gear behind the transmission."""

    units = ("kg", "kg m²")

    @staticmethod
    def signal(joint: JointState, terms: JointTerms, math: Any) -> Any:
        return joint.acceleration


class CoulombFriction(JointTerm):
    """Fc sign q̇, smoothed and with a dead zone as the terms say."""

    units = ("N", "N m")

    @staticmethod
    def signal(joint: JointState, terms: JointTerms, math: Any) -> Any:
        rate = joint.rate
        sign = math.tanh(rate / terms.smoothing) if terms.smoothing else math.sign(rate)
        return sign * (math.fabs(rate) > terms.dead_zone) if terms.dead_zone else sign


class ViscousFriction(JointTerm):
    """Fv q̇."""

    units = ("N s/m", "N m s/rad")

    @staticmethod
    def signal(joint: JointState, terms: JointTerms, math: Any) -> Any:
        return joint.rate


class Offset(JointTerm):
    """Fo: a constant force, as of an amplifier's zero."""

    units = ("N", "N m")

    @staticmethod
    def signal(joint: JointState, terms: JointTerms, math: Any) -> Any:
        return 1.0


# By their kinds, which label the parameters and are written in files.
JOINT_TERMS: dict[str, type[JointTerm]] = {
    "Ia": DriveInertia,
    "Fc": CoulombFriction,
    "Fv": ViscousFriction,
    "Fo": Offset,
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

    Raises
    ------
    OptionError
        When a kind is unknown, or a rate is negative.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("five_bar")
    >>> terms = loopid.JointTerms(robot.actuated, ("Fc", "Fv"))
    >>> terms.parameters(robot).labels
    ('left_crank_joint.Fc', 'left_crank_joint.Fv', 'right_crank_joint.Fc', 'right_crank_joint.Fv')
    """

    joints: tuple[str, ...]
    kinds: tuple[str, ...] = ("Fc", "Fv")
    dead_zone: float = 0.0
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        for kind in self.kinds:
            if kind not in JOINT_TERMS:
                raise OptionError.unknown("joint term", kind, JOINT_TERMS)
        for name in ("dead_zone", "smoothing"):
            if not 0 <= getattr(self, name) < np.inf:
                raise OptionError(f"{name} must be a rate from 0 on, not {getattr(self, name)}")

    def parameters(self, mechanism: Mechanism) -> ParameterSet:
        """Labels ``<joint>.<kind>``, joint by joint; the names of ``columns``."""
        return ParameterSet(
            tuple(
                Parameter(joint, kind, JOINT_TERMS[kind].units[index not in mechanism.prismatic])
                for joint in self.joints
                for index in (_index(mechanism, joint),)
                for kind in self.kinds
            )
        )

    def columns(self, mechanism: Mechanism, motion: ClosedMotion) -> FloatArray:
        """Actuator forces (N, dof, k) per unit of each of ``parameters``."""
        G, columns = motion.projection.G, []
        for name in self.joints:
            index, joint = _index(mechanism, name), mechanism.joint(name)
            q = motion.configurations[:, joint.idx_q : joint.idx_q + joint.nq]
            # A continuous joint is stored as the cosine and sine of its angle.
            position = q[:, 0] if joint.nq == 1 else np.arctan2(q[:, 1], q[:, 0])
            v, a = motion.velocities[:, index], motion.accelerations[:, index]
            state = JointState(position, v, a)
            for kind in self.kinds:
                signal = np.broadcast_to(JOINT_TERMS[kind].signal(state, self, np), len(q))
                columns.append(G[:, index] * signal[:, None])
        return np.stack(columns, axis=2)


def _index(mechanism: Mechanism, joint: str) -> int:
    indices = mechanism.velocity_indices([joint])
    if len(indices) != 1:
        raise OptionError(f"joint {joint} has {len(indices)} coordinates, terms need one")
    return int(indices[0])
