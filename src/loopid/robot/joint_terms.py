"""Forces in the joints themselves: drive inertia, friction, springs and offsets.

Each kind is one class with its law, units and sign; ``JOINT_TERMS`` is the registry. The motors
give a coefficient times a signal, such as q̈ or sign q̇, beside what moves the bodies
[Khalil2004, ch. 12].
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import isfinite, nan
from typing import Any, ClassVar, NamedTuple

from loopid.errors import OptionError


class JointState(NamedTuple):
    """Position, rate and acceleration of a joint: arrays (N,), or CasADi expressions."""

    position: Any
    rate: Any
    acceleration: Any


@dataclass(frozen=True)
class JointTerm(ABC):
    """A kind of force in a joint.

    Attributes
    ----------
    at : float
        The number in kinds such as ``"Ks@0.2"``, of which the law depends nonlinearly: a position
        in m or rad, a rate in m/s or rad/s. 0 where the kind has none.
    name : str
        In sentences.
    units : tuple of str
        Of the coefficient, for a sliding and for a turning joint.
    beside : tuple of str
        Kinds that the law has further coefficients of.
    needs_position : bool
        Whether a coordinate of a joint with several, which has a rate only, cannot have it.
    """

    at: float = 0.0
    name: ClassVar[str]
    units: ClassVar[tuple[str, str]]
    beside: ClassVar[tuple[str, ...]] = ()
    needs_position: ClassVar[bool] = False

    @abstractmethod
    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        """What the coefficient multiplies; ``math`` is NumPy, or CasADi for exported C code.

        ``terms`` is a ``JointTerms``, for what the law is refined by.
        """


class DriveInertia(JointTerm):
    """Ia q̈: rotor and gear behind the transmission; also called armature."""

    name = "drive inertia"
    units = ("kg", "kg m²")

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        return joint.acceleration


class CoulombFriction(JointTerm):
    """Fc sign q̇, smoothed and with a dead zone as the terms say."""

    name = "Coulomb friction"
    units = ("N", "N m")

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        rate, width = joint.rate, self.at or terms.smoothing
        sign = math.tanh(rate / width) if width else math.sign(rate)
        return sign * (math.fabs(rate) > terms.dead_zone) if terms.dead_zone else sign


class SmoothCoulombFriction(CoulombFriction):
    """Fc tanh(q̇ / width)."""

    name = "smooth Coulomb friction"


class ForwardFriction(CoulombFriction):
    """Coulomb friction while the rate is positive."""

    name = "Coulomb friction forward"

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        return math.fmax(super().signal(joint, terms, math), 0.0)


class BackwardFriction(CoulombFriction):
    """Coulomb friction while the rate is negative; its coefficient is positive too."""

    name = "Coulomb friction backward"

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        return math.fmin(super().signal(joint, terms, math), 0.0)


class StribeckFriction(CoulombFriction):
    """Fs exp(-(q̇ / rate)²) sign q̇: what friction has more near standstill [Armstrong1994]."""

    name = "Stribeck friction"

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        sign = CoulombFriction().signal(joint, terms, math)
        return math.exp(-((joint.rate / self.at) ** 2)) * sign


class ViscousFriction(JointTerm):
    """Fv q̇: damping."""

    name = "viscous friction"
    units = ("N s/m", "N m s/rad")

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        return joint.rate


class Offset(JointTerm):
    """Fo: a constant force, as of an amplifier's zero or of a spring under tension."""

    name = "constant force"
    units = ("N", "N m")

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        return 1.0


class Spring(JointTerm):
    """Ks q + Fo = Ks (q - q0): a spring that is slack at q0 = -Fo / Ks."""

    name = "spring"
    units = ("N/m", "N m/rad")
    beside: ClassVar[tuple[str, ...]] = ("Fo",)
    needs_position = True

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        return joint.position


class QuadraticSpring(Spring):
    """Ks2 q² + Ks q + Fo."""

    name = "quadratic spring"
    units = ("N/m²", "N m/rad²")
    beside = ("Ks", "Fo")

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        return joint.position**2


class CubicSpring(Spring):
    """Ks3 q³ + Ks2 q² + Ks q + Fo."""

    name = "cubic spring"
    units = ("N/m³", "N m/rad³")
    beside = ("Ks2", "Ks", "Fo")

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        return joint.position**3


class BentSpring(Spring):
    """Stiffness that a spring gains above a position: piecewise linear beside Ks, else a stop."""

    name = "stiffness gained"
    beside = ()

    def signal(self, joint: JointState, terms: Any, math: Any) -> Any:
        return math.fmax(joint.position - self.at, 0.0)


# By their kinds, which label the parameters and are written in files; in place of the words in
# capitals stands a number.
JOINT_TERMS: dict[str, type[JointTerm]] = {
    "Ia": DriveInertia,
    "Fc": CoulombFriction,
    "Fc+": ForwardFriction,
    "Fc-": BackwardFriction,
    "Fc~RATE": SmoothCoulombFriction,
    "Fs~RATE": StribeckFriction,
    "Fv": ViscousFriction,
    "Fo": Offset,
    "Ks": Spring,
    "Ks2": QuadraticSpring,
    "Ks3": CubicSpring,
    "Ks@POSITION": BentSpring,
}
MARKS = {"~": "RATE", "@": "POSITION"}


def joint_term(kind: str, others: Iterable[str] = ()) -> JointTerm:
    """The term of a kind such as ``"Fc"`` or ``"Ks@0.2"``.

    Where other words than kinds would do, an error names them too.

    Raises
    ------
    OptionError
        When there is no such kind, or its number makes no sense.
    """
    mark = next((mark for mark in MARKS if mark in kind), "")
    stem, _, number = kind.partition(mark) if mark else (kind, "", "")
    law = JOINT_TERMS.get(stem + mark + MARKS.get(mark, ""))
    if law is None:
        raise OptionError.unknown("joint term", kind, (*JOINT_TERMS, *others))
    if not mark:
        return law()
    try:
        at = float(number)
    except ValueError:
        at = nan
    if not isfinite(at) or (mark == "~" and at <= 0):
        what = "rate above 0" if mark == "~" else "position"
        raise OptionError(f"joint term {kind!r} needs a {what} after {mark}, not {number!r}")
    return law(at)


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
