"""Laws of forces in the joints themselves: drive inertia, friction, springs and offsets.

The motors give a coefficient times a signal, such as q̈ or sign q̇, beside what moves the bodies
[Khalil2004, ch. 12]. ``JOINT_TERMS`` is the registry of the laws: a new one is an entry there, from
anywhere. Errors in it are raised at registration, or when it first meets a joint.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from math import isfinite, nan
from typing import Any, Literal, NamedTuple

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import DataError, LoopidError, OptionError
from loopid.parameters import KINDS
from loopid.records import record
from loopid.registry import Registry


class JointState(NamedTuple):
    """What a law may need of a joint: arrays (N,), or CasADi expressions for exported C code.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.regressors import JOINT_TERMS, JointState
    >>> still = np.zeros(2)
    >>> moving = JointState(still, np.array([-0.1, 0.2]), still, math=np)
    >>> JOINT_TERMS["Fv"].law(moving, 0.0).tolist()
    [-0.1, 0.2]
    """

    position: Any  # in m or rad; None of one of several coordinates of a joint
    rate: Any
    acceleration: Any
    load: Any = None  # force in N that the bearing carries
    math: Any = None  # NumPy or CasADi: ``fmax``, ``fmin``, ``fabs``, ``exp``, ``tanh``, ``sign``
    # In m/s or rad/s: up to which rate a joint stands, and over which its sign is smoothed
    dead_zone: float = 0.0
    smoothing: float = 0.0
    # Size of the motor's force that moves the bodies, in N or N m; columns are per unit of it
    torque: Any = 1.0
    # States of elements of Maxwell slip by their displacements; None where nothing is known of them
    slips: Mapping[float, Any] | None = None

    def slip(self, displacement: float) -> Any:
        """State of an element of Maxwell slip, from -1 to 1; that of steady motion by default."""
        return self.sign() if self.slips is None else self.slips[displacement]

    def sign(self, width: float = 0.0) -> Any:
        """Sign of the rate, with the dead zone; smoothed over a width, or as the state says."""
        width = width or self.smoothing
        sign = self.math.tanh(self.rate / width) if width else self.math.sign(self.rate)
        return sign * (self.math.fabs(self.rate) > self.dead_zone) if self.dead_zone else sign


# What coefficients are measured in, such as N s²/m² or kg m².
ONE_UNIT = r"(?:N|m|rad|s|kg)[²³]?"
NO_UNIT = "1"
UNIT = re.compile(rf"|(?:{NO_UNIT}|{ONE_UNIT}(?: {ONE_UNIT})*)(?:/{ONE_UNIT}(?: {ONE_UNIT})*)?")
OF_RATE = {"sign": "rate", "slip": "rate"}  # what the state has it from
Need = Literal["position", "rate", "acceleration", "load", "torque", "sign", "slip"]


@record
class PriorGroup:
    """Terms of a joint that share one prior deviation, which the evidence of the data chooses.

    For laws of many coefficients, such as the points of a curve. Where the data ask for none, all
    are zero.
    """

    name: str  # of the terms of one joint together, in sentences
    # Largest prior deviation: of a coefficient without unit as it is, else relative to the rms
    # force of the motor
    largest: float = 1.0
    # Prior correlation (k, k) of the law at numbers (k,), of a joint whose terms have numbers
    # ``at``; by default its terms are independent
    correlation: Callable[[FloatArray, FloatArray], FloatArray] | None = None


@record(checked="outside")
class JointTerm:
    """A law of a force in a joint.

    Attributes
    ----------
    name : str
        In sentences.
    units : tuple of str
        Of the coefficient, for a sliding and for a turning joint; ``""`` or ``"1"`` for a number
        without unit.
    law : callable
        What the coefficient multiplies, of a ``JointState`` and the number ``at``.
    needs : tuple of str
        What it needs of the state: "position", "rate", "acceleration", "load", "torque", "sign",
        "slip". Coordinates of a joint with several have no position. What follows the sign of the
        rate jumps; what follows slip hangs on where the joint came from.
    beside : tuple of str
        Kinds that the law has further coefficients of.
    at : float
        The number in kinds such as ``"Ks@0.2"``, of which the law depends nonlinearly: a position
        or displacement in m or rad, a rate in m/s or rad/s. 0 where the kind has none.
    positive : bool
        Whether the coefficient cannot be negative: friction that would drive, inertia below zero.
    most : float, optional
        Largest coefficient that there can be.
    prior : PriorGroup, optional
        The group of terms whose size the evidence decides.
    pole : bool
        Whether the law is infinite at the position ``at``, so the joint must stay on one side.

    Raises
    ------
    OptionError
        When a unit or a need is unknown.

    Examples
    --------
    Drag, for all that takes kinds of joint terms:

    >>> import loopid
    >>> from loopid.regressors import JOINT_TERMS, JointTerm
    >>> def drag(joint, at):
    ...     return joint.rate * joint.math.fabs(joint.rate)
    >>> units = ("N s²/m²", "N m s²/rad²")
    >>> JOINT_TERMS.register("Fd", JointTerm("drag", units, drag, needs=("rate",)))
    >>> robot = loopid.load("3ups_rpu")
    >>> [each.unit for each in loopid.JointTerms(("leg1_stroke",), ("Fd",)).parameters(robot)]
    ['N s²/m²']
    """

    name: str
    units: tuple[str, str]
    law: Callable[[JointState, float], Any]
    needs: tuple[Need, ...] = ()
    beside: tuple[str, ...] = ()
    at: float = 0.0
    positive: bool = False
    most: float | None = None
    prior: PriorGroup | None = None
    pole: bool = False

    def __post_init__(self) -> None:
        for unit in self.units:
            if not UNIT.fullmatch(unit):
                raise OptionError(
                    f"the unit of {self.name} must be made of N, m, rad, s and kg, such as "
                    f"N s²/m², or 1 for a number without unit, not {unit!r}",
                    given=unit,
                )
        plain = tuple("" if unit == NO_UNIT else unit for unit in self.units)
        object.__setattr__(self, "units", plain)

    def signal(self, joint: JointState, count: int) -> FloatArray:
        """What the coefficient multiplies in ``count`` states of a joint, (count,)."""
        found = np.asarray(self.law(joint, self.at), dtype=np.float64)
        if found.shape not in ((), (count,)):
            raise DataError(
                f"the law of {self.name} must give shape ({count},), not {found.shape}",
                given=found.shape,
            )
        if not np.isfinite(found).all():
            k = int(np.argmin(np.isfinite(np.broadcast_to(found, count))))
            state = joint._asdict()
            place = ", ".join(f"{n} {np.broadcast_to(state[n], count)[k]:.6g}" for n in self._used)
            raise DataError(f"the law of {self.name} is not finite at {place or 'any state'}")
        return np.broadcast_to(found, count)

    def require_one_side(self, joint: str, positions: FloatArray) -> None:
        """Refuse positions (N,) of a joint on both sides of the pole, where the law is finite."""
        if self.pole and len(positions) and positions.min() <= self.at <= positions.max():
            raise DataError(
                f"the {self.name} of {joint} is infinite at {self.at:g}, between its positions "
                f"{positions.min():.4g} and {positions.max():.4g}: give one outside its limits",
                joint=joint,
                given=self.at,
            )

    @property
    def _used(self) -> tuple[str, ...]:
        """Fields of the state that it needs."""
        return tuple(dict.fromkeys(OF_RATE.get(need, need) for need in self.needs))

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


# A friction curve is a line Fc + Fv |q̇| and what departs from it, a sum of hats at rates that
# double: linear between them, flat from standstill to the first, none from the last on. Its
# asymmetry, which has one sign both ways, is none up to the first rate and flat from the last on.
RATIO = 2.0
# Factor of the rate over which a departure is alike, in logarithms: of e.
ALIKE = 1.0
# Largest part of its load that a gear loses: an efficiency of two thirds.
MOST_LOST = 0.5


def _hat(joint: JointState, at: float, first: bool = False, last: bool = False) -> Any:
    """1 at the rate, 0 at those before and after it; the first is flat below, the last above."""
    rate = joint.math.fabs(joint.rate)
    below = 1.0 if first else (RATIO * rate / at - 1) / (RATIO - 1)
    above = 1.0 if last else (RATIO - rate / at) / (RATIO - 1)
    return joint.math.fmax(0.0, joint.math.fmin(below, above))


def _alike(rates: FloatArray, none: float) -> FloatArray:
    """Correlation (k, k) of departures at rates (k,) that are none at another rate."""
    logarithms = np.log(np.append(rates, none))
    apart = (logarithms[:, None] - logarithms) / ALIKE
    whole = np.exp(-0.5 * apart**2) + NUGGET * np.eye(len(logarithms))
    return np.asarray(whole[:-1, :-1] - np.outer(whole[:-1, -1], whole[-1, :-1]) / whole[-1, -1])


NUGGET = 1e-4  # of a correlation: departures that are not alike, and no round-off
CURVE = PriorGroup("friction curve", 1.0, lambda rates, at: _alike(rates, RATIO * at.max()))
ASYMMETRY = PriorGroup("friction asymmetry", 1.0, lambda rates, at: _alike(rates, at.min() / RATIO))
LOAD = PriorGroup("load friction", 0.2)
HYSTERESIS = PriorGroup("hysteresis", 1.0)


def _point(name: str, law: Callable[[JointState, float], Any], prior: PriorGroup) -> JointTerm:
    """A point of a curve; it is made at the rate of the log, as all that needs the sign."""
    return JointTerm(name, ("N", "N m"), law, ("rate", "sign"), prior=prior)


class JointTermRegistry(Registry[JointTerm]):
    """Joint terms by their kinds."""

    def register(self, name: str, entry: JointTerm | str) -> None:
        """Add a joint term, or put it in the place of one of the same kind.

        Parameters
        ----------
        name : str
            The kind: letters, digits and signs, and for a law with a number ``~RATE`` or
            ``@POSITION`` or ``@DISPLACEMENT`` at its end.
        entry : JointTerm

        Raises
        ------
        OptionError
            When the kind cannot be one, or the law fails with what it says that it needs.
        DataError
            When the law does not give a number for each state.
        """
        if not KIND.fullmatch(name) or name in (*KINDS, *WORDS):
            raise OptionError(
                f"a kind of joint term must be a word such as Fd, Fd~RATE or Kd@POSITION, other "
                f"than those of bodies and than {', '.join(WORDS)}, not {name!r}",
                given=name,
            )
        if isinstance(entry, JointTerm):
            _try(name, entry)
        elif not isinstance(entry, str):
            raise OptionError(
                f"joint term {name} must be a JointTerm, or 'module:name' of one, not "
                f"{getattr(entry, '__name__', type(entry).__name__)}",
                given=name,
            )
        super().register(name, entry)
        joint_term.cache_clear()


# Words of a choice of terms, and what a kind may look like.
WORDS = "file", "none", "passive", "auto"
KIND = re.compile(r"[A-Za-z][A-Za-z0-9+-]*(~RATE|@POSITION|@DISPLACEMENT)?")
# A joint that a law is tried with.
TRIED = {"position": (-0.4, 0.1, 0.7), "rate": (0.5, -1.0, 0.2), "acceleration": (1.0, 0.3, -2.0)}
TRIED |= {"load": (3.0, 1.0, 2.0), "torque": (1.0, 4.0, 2.0)}
TRIED_AT = 0.3


def _try(kind: str, term: JointTerm) -> None:
    """Refuse a law that fails with what it needs; where it is finite depends on the joint."""
    given: dict[str, Any] = {name: np.array(TRIED[name]) for name in term._used}
    blank: dict[str, Any] = dict.fromkeys(TRIED)
    with np.errstate(all="ignore"):
        try:
            found = term.law(JointState(**blank | given, math=np), TRIED_AT)
            shape = np.asarray(found, dtype=np.float64).shape
        except LoopidError:
            raise
        except (AttributeError, TypeError, ValueError) as error:
            needs = ", ".join(term.needs) or "nothing of the joint"
            raise OptionError(
                f"the law of joint term {kind} fails with arrays of what it needs ({needs}): "
                f"{error}",
                given=kind,
                needs=term.needs,
            ) from error
    if shape not in ((), (3,)):
        raise DataError(
            f"the law of joint term {kind} must give shape (3,) for 3 states, not {shape}",
            given=shape,
        )


MARKS = "~", "@"


@cache
def joint_term(kind: str, others: tuple[str, ...] = ()) -> JointTerm:
    """The term of a kind such as ``"Fc"`` or ``"Ks@0.2"``; errors also name other words."""
    mark = next((mark for mark in MARKS if mark in kind), "")
    stem, _, number = kind.partition(mark) if mark else (kind, "", "")
    name = next((known for known in JOINT_TERMS if mark and known.startswith(stem + mark)), kind)
    if name not in JOINT_TERMS:
        raise OptionError.unknown("joint term", kind, (*JOINT_TERMS, *others))
    term = JOINT_TERMS[name]
    if not mark:
        return term
    try:
        at = float(number)
    except ValueError:
        at = nan
    slides = "slip" in term.needs
    if not isfinite(at) or ((mark == "~" or slides) and at <= 0):
        what = "rate above 0" if mark == "~" else "displacement above 0" if slides else "position"
        raise OptionError(
            f"joint term {kind!r} needs a {what} after {mark}, not {number!r}", given=kind
        )
    return replace(term, at=at)


# By their kinds, which label the parameters and are written in files; in place of the words in
# capitals stands a number. A spring Ks q + Fo = Ks (q - q0) is slack at q0 = -Fo / Ks; a gain of
# stiffness above a position makes it piecewise linear, or a stop. The gas of a cylinder that would
# be closed up at a position presses by 1 / (q - at) (Boyle's law). Stribeck friction is what there
# is more near standstill [Armstrong1994]. Hysteresis is what friction that builds up over a
# displacement has less after a reversal than Coulomb friction, which it is a part of: none in
# steady motion (``maxwell_slip.py``).
JOINT_TERMS = JointTermRegistry("joint term")
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
    "Fs~RATE": JointTerm(
        "Stribeck friction",
        ("N", "N m"),
        lambda joint, at: joint.math.exp(-((joint.rate / at) ** 2)) * joint.sign(),
        ("rate", "sign"),
    ),
    "Fk0~RATE": _point("friction curve", lambda j, at: _hat(j, at, first=True) * j.sign(), CURVE),
    "Fk~RATE": _point("friction curve", lambda j, at: _hat(j, at) * j.sign(), CURVE),
    "Fa~RATE": _point("friction asymmetry", _hat, ASYMMETRY),
    "Fa1~RATE": _point("friction asymmetry", lambda j, at: _hat(j, at, last=True), ASYMMETRY),
    "Ft": JointTerm(
        "load friction",
        ("1", "1"),
        lambda joint, _: joint.torque * joint.sign(),
        ("torque", "sign"),
        positive=True,
        most=MOST_LOST,
        prior=LOAD,
    ),
    "Fh@DISPLACEMENT": JointTerm(
        "hysteresis",
        ("N", "N m"),
        lambda joint, at: joint.slip(at) - joint.sign(),
        ("rate", "sign", "slip"),
        positive=True,
        prior=HYSTERESIS,
    ),
    "Fl": _load_friction("friction of loaded bearings"),
    "Fl~RATE": _load_friction("smooth friction of loaded bearings"),
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
    "Kg@POSITION": JointTerm(
        "gas spring",
        ("N m", "N m rad"),
        lambda joint, at: 1.0 / (joint.position - at),
        ("position",),
        pole=True,
    ),
}.items():
    JOINT_TERMS.register(_kind, _term)


def signals(kinds: Sequence[str], joint: JointState, count: int) -> FloatArray:
    """What coefficients of kinds (k,) multiply in ``count`` states of a joint, (count, k)."""
    found = [joint_term(kind).signal(joint, count) for kind in kinds]
    return np.array(found).reshape(len(kinds), count).T


def grouped(kind: str) -> bool:
    """Whether a kind of parameter is a joint term whose size the evidence decides."""
    return kind not in KINDS and joint_term(kind).prior is not None
