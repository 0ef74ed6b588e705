"""Laws of forces in the joints themselves: drive inertia, friction, springs and offsets.

The motors give a coefficient times a signal, such as q̈ or sign q̇, beside what moves the bodies
[Khalil2004, ch. 12]. ``JOINT_TERMS`` is the registry of the laws: a new one is an entry there, from
anywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import isfinite, nan
from typing import Any, NamedTuple

from loopid.errors import OptionError
from loopid.records import record
from loopid.registry import Registry


class JointState(NamedTuple):
    """What a law may need of a joint: arrays (N,), or CasADi expressions for exported C code."""

    position: Any  # in m or rad; None of one of several coordinates of a joint
    rate: Any
    acceleration: Any
    load: Any = None  # force in N that the bearing carries
    math: Any = None  # NumPy or CasADi: ``fmax``, ``fabs``, ``exp``, ``tanh``, ``sign``
    # In m/s or rad/s: up to which rate a joint stands, and over which its sign is smoothed
    dead_zone: float = 0.0
    smoothing: float = 0.0

    def sign(self, width: float = 0.0) -> Any:
        """Sign of the rate, with the dead zone; smoothed over a width, or as the state says."""
        width = width or self.smoothing
        sign = self.math.tanh(self.rate / width) if width else self.math.sign(self.rate)
        return sign * (self.math.fabs(self.rate) > self.dead_zone) if self.dead_zone else sign


@record
class JointTerm:
    """A law of a force in a joint.

    Attributes
    ----------
    name : str
        In sentences.
    units : tuple of str
        Of the coefficient, for a sliding and for a turning joint.
    law : callable
        What the coefficient multiplies, of a ``JointState`` and the number ``at``.
    needs : tuple of str
        What it needs of the state: "position", "rate", "acceleration", "load", "sign". Coordinates
        of a joint with several have no position. What follows the sign of the rate jumps.
    beside : tuple of str
        Kinds that the law has further coefficients of.
    at : float
        The number in kinds such as ``"Ks@0.2"``, of which the law depends nonlinearly: a position
        in m or rad, a rate in m/s or rad/s. 0 where the kind has none.
    positive : bool
        Whether the coefficient cannot be negative: friction that would drive, inertia below zero.

    Examples
    --------
    Drag, for all that takes kinds of joint terms:

    >>> import loopid
    >>> from loopid.regressors import JOINT_TERMS, JointTerm
    >>> def drag(joint, at):
    ...     return joint.rate * joint.math.fabs(joint.rate)
    >>> units = ("N s²/m²", "N m s²/rad²")
    >>> JOINT_TERMS.register("Fd", JointTerm("drag", units, drag, needs=("rate",)))
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> [each.unit for each in loopid.JointTerms(("leg1_stroke",), ("Fd",)).parameters(robot)]
    ['N s²/m²']
    """

    name: str
    units: tuple[str, str]
    law: Callable[[JointState, float], Any]
    needs: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    at: float = 0.0
    positive: bool = False

    @property
    def friction(self) -> bool:
        """Whether the law is of the rate alone."""
        return bool(self.needs) and {*self.needs} <= {"rate", "sign"}


def _coulomb(name: str, law: Callable[[JointState, float], Any]) -> JointTerm:
    return JointTerm(name, ("N", "N m"), law, ("sign",), positive=True)


def _load_friction(name: str) -> JointTerm:
    """Friction by Coulomb's law; in a hinge the coefficient holds the radius of the pin."""
    return JointTerm(
        name,
        ("N/N", "N m/N"),
        lambda joint, at: joint.load * joint.sign(at),
        needs=("load", "sign"),
        positive=True,
    )


def _spring(
    name: str, power: str, beside: tuple[str, ...], law: Callable[[JointState, float], Any]
) -> JointTerm:
    return JointTerm(name, (f"N/m{power}", f"N m/rad{power}"), law, ("position",), beside)


def _stribeck(joint: JointState, at: float) -> Any:
    return joint.math.exp(-((joint.rate / at) ** 2)) * joint.sign()


# By their kinds, which label the parameters and are written in files; in place of the words in
# capitals stands a number. A spring Ks q + Fo = Ks (q - q0) is slack at q0 = -Fo / Ks; a gain of
# stiffness above a position makes it piecewise linear, or a stop. Stribeck friction is what there
# is more near standstill [Armstrong1994].
JOINT_TERMS: Registry[JointTerm] = Registry("joint term")
for _kind, _term in {
    "Ia": JointTerm(
        "drive inertia",
        ("kg", "kg m²"),
        lambda joint, _: joint.acceleration,
        ("acceleration",),
        positive=True,
    ),
    "Fc": _coulomb("Coulomb friction", lambda joint, _: joint.sign()),
    "Fc+": _coulomb(
        "Coulomb friction forward", lambda joint, _: joint.math.fmax(joint.sign(), 0.0)
    ),
    "Fc-": _coulomb(
        "Coulomb friction backward", lambda joint, _: joint.math.fmin(joint.sign(), 0.0)
    ),
    "Fc~RATE": _coulomb("smooth Coulomb friction", lambda joint, at: joint.sign(at)),
    "Fs~RATE": JointTerm("Stribeck friction", ("N", "N m"), _stribeck, ("rate", "sign")),
    "Fl": _load_friction("load-dependent friction"),
    "Fl~RATE": _load_friction("smooth load-dependent friction"),
    "Fv": JointTerm(
        "viscous friction",
        ("N s/m", "N m s/rad"),
        lambda joint, _: joint.rate,
        ("rate",),
        positive=True,
    ),
    "Fo": JointTerm("constant force", ("N", "N m"), lambda joint, _: 1.0),
    "Ks": _spring("spring", "", ("Fo",), lambda joint, _: joint.position),
    "Ks2": _spring("quadratic spring", "²", ("Ks", "Fo"), lambda joint, _: joint.position**2),
    "Ks3": _spring("cubic spring", "³", ("Ks2", "Ks", "Fo"), lambda joint, _: joint.position**3),
    "Ks@POSITION": _spring(
        "stiffness gained", "", (), lambda joint, at: joint.math.fmax(joint.position - at, 0.0)
    ),
}.items():
    JOINT_TERMS.register(_kind, _term)
MARKS = {"~": "RATE", "@": "POSITION"}


def joint_term(kind: str, others: Iterable[str] = ()) -> JointTerm:
    """The term of a kind such as ``"Fc"`` or ``"Ks@0.2"``.

    Where other words than kinds would do, an OptionError names them too.
    """
    mark = next((mark for mark in MARKS if mark in kind), "")
    stem, _, number = kind.partition(mark) if mark else (kind, "", "")
    name = stem + mark + MARKS.get(mark, "")
    if name not in JOINT_TERMS:
        raise OptionError.unknown("joint term", kind, (*JOINT_TERMS, *others))
    term = JOINT_TERMS[name]
    if not mark:
        return term
    try:
        at = float(number)
    except ValueError:
        at = nan
    if not isfinite(at) or (mark == "~" and at <= 0):
        what = "rate above 0" if mark == "~" else "position"
        raise OptionError(
            f"joint term {kind!r} needs a {what} after {mark}, not {number!r}", given=kind
        )
    return replace(term, at=at)
