"""Forces in the joints themselves: drive inertia, friction, springs and offsets.

Each kind is one class with its law, units and sign; ``JOINT_TERMS`` is the registry. The motors
give a coefficient times a signal, such as q̈ or sign q̇, beside what moves the bodies
[Khalil2004, ch. 12].
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple


class JointState(NamedTuple):
    """Position, rate and acceleration of a joint: arrays (N,), or CasADi expressions."""

    position: Any
    rate: Any
    acceleration: Any


class JointTerm(ABC):
    """A kind of force in a joint.

    Attributes
    ----------
    name : str
        In sentences.
    units : tuple of str
        Of the coefficient, for a sliding and for a turning joint.
    beside : tuple of str
        Kinds that the law has further coefficients of.
    needs_position : bool
        Whether a coordinate of a joint with several, which has a rate only, cannot have it.
    """

    name: ClassVar[str]
    units: ClassVar[tuple[str, str]]
    beside: ClassVar[tuple[str, ...]] = ()
    needs_position: ClassVar[bool] = False

    @staticmethod
    @abstractmethod
    def signal(joint: JointState, terms: Any, math: Any) -> Any:
        """What the coefficient multiplies; ``math`` is NumPy, or CasADi for exported C code.

        ``terms`` is a ``JointTerms``, for what the law is refined by.
        """


class DriveInertia(JointTerm):
    """Ia q̈: rotor and gear behind the transmission; also called armature."""

    name = "drive inertia"
    units = ("kg", "kg m²")

    @staticmethod
    def signal(joint: JointState, terms: Any, math: Any) -> Any:
        return joint.acceleration


class CoulombFriction(JointTerm):
    """Fc sign q̇, smoothed and with a dead zone as the terms say."""

    name = "Coulomb friction"
    units = ("N", "N m")

    @staticmethod
    def signal(joint: JointState, terms: Any, math: Any) -> Any:
        rate = joint.rate
        sign = math.tanh(rate / terms.smoothing) if terms.smoothing else math.sign(rate)
        return sign * (math.fabs(rate) > terms.dead_zone) if terms.dead_zone else sign


class ViscousFriction(JointTerm):
    """Fv q̇: damping."""

    name = "viscous friction"
    units = ("N s/m", "N m s/rad")

    @staticmethod
    def signal(joint: JointState, terms: Any, math: Any) -> Any:
        return joint.rate


class Offset(JointTerm):
    """Fo: a constant force, as of an amplifier's zero or of a spring under tension."""

    name = "constant force"
    units = ("N", "N m")

    @staticmethod
    def signal(joint: JointState, terms: Any, math: Any) -> Any:
        return 1.0


class Spring(JointTerm):
    """Ks q + Fo = Ks (q - q0): a spring that is slack at q0 = -Fo / Ks."""

    name = "spring"
    units = ("N/m", "N m/rad")
    beside = ("Fo",)
    needs_position = True

    @staticmethod
    def signal(joint: JointState, terms: Any, math: Any) -> Any:
        return joint.position


# By their kinds, which label the parameters and are written in files.
JOINT_TERMS: dict[str, type[JointTerm]] = {
    "Ia": DriveInertia,
    "Fc": CoulombFriction,
    "Fv": ViscousFriction,
    "Fo": Offset,
    "Ks": Spring,
}


@dataclass(frozen=True)
class LeftOut:
    """What the robot file gives of forces and no model has.

    Attributes
    ----------
    what : str
        The force and where it acts, such as ``"gravity compensation of upper"``.
    weights : mapping
        Link to mass and centre of mass in its frame, (4,), whose weight the force carries.
    tendon : mapping
        Coordinate to the factor with which it enters the length of a tendon.
    values : mapping
        Kinds of joint terms to the tendon's coefficients of them.

    is_force : bool
        Otherwise what forces and positions are counted by, such as a gear.

    Without weights and tendon the size of the force is not known.
    """

    what: str
    weights: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    tendon: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    is_force: bool = True
