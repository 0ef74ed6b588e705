"""Kinds of mistakes in logs: what is scaled, moved or exchanged, why, and what undoes it.

A size is called by the nearest cause that people have for it, and advice can be typed.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, log, pi
from typing import Any, NamedTuple

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import first_of
from loopid.identification.evidence import Evidence, Explanation, Undone
from loopid.identification.own_gains import OwnGains

# Half of the 95 % interval at most, as a part of the size: a size that is not known is none.
KNOWN = 0.5
LARGEST = 10.0  # gain, over the one with which all bodies would weigh as in the file
TURN = 2 * pi  # motors hardly move further, in rad or characteristic lengths
Motors = tuple[int, ...]
Cause = tuple[float, str]  # a size, and what it is called; nothing of a factor without a name
# A title, the size with its interval where it has one, and what to do, such that it can be typed.
Called = tuple[str, str, str]


class MistakeKind(NamedTuple):
    """A kind of mistake: what is scaled or moved, or exchanged where it has no sizes."""

    fields: tuple[str, ...]  # of what is undone
    motors: int  # it is of this many; 0 for all
    call: Callable[[Mistaken], Called]
    sizes: tuple[float, ...] = ()  # that are tried first, evenly spread
    signs: tuple[float, ...] = (1.0,)
    causes: tuple[Cause, ...] = ()  # that people have, by the size
    slack: float = 0.15  # of the logarithm of a size about that of its cause
    least: float = 1.0  # size that is worth a sentence
    # Sizes that mistakes often have, and what a log does not show that may as well have them.
    usual: tuple[float, ...] = ()
    hidden: str = ""
    alone: bool = False  # each motor has a size of its own, that own_gains.py finds

    def undone(self, undone: Undone, motors: Motors, size: float) -> Undone:
        """With a mistake of some motors undone, too."""

        def changed(values: tuple[Any, ...]) -> tuple[Any, ...]:
            if self.added:
                return tuple(v + size * (k in motors) for k, v in enumerate(values))
            if self.sizes or size != 1.0:
                return tuple(v * size if k in motors else v for k, v in enumerate(values))
            order = dict(zip(motors, reversed(motors), strict=True))
            return tuple(values[order.get(k, k)] for k in range(len(values)))

        return undone._replace(**{name: changed(getattr(undone, name)) for name in self.fields})

    def cause(self, size: float, reach: float) -> Cause | None:
        """The nearest cause that explains a size with this half of its interval.

        A gain that is not known has none.
        """
        if self.fields == ("gain",) and reach > KNOWN * abs(size):
            return None
        near = [
            (abs(log(size / factor)), (factor, words))
            for factor, words in self.causes
            if size * factor > 0
        ]
        off, cause = min(near, default=(inf, (1.0, "")))
        return cause if off <= max(self.slack, reach / abs(size)) else None

    @property
    def added(self) -> bool:
        """Whether sizes are added, as a zero, and no factors."""
        return self.fields == ("zero",)

    @property
    def assembled(self) -> bool:
        """Whether the loops must be closed anew."""
        return "ratio" in self.fields or self.added

    def tried(self, model: Evidence, undone: Undone, motors: Motors) -> FloatArray:
        """Sizes that are tried first, but for impossible ones."""
        signs = np.array(self.signs)
        if self.fields in (("ratio",), ("time",)) and model.rates_measured:
            return np.compress(signs == -1.0, signs)  # velocities of the log prove the size
        if not self.sizes:
            return signs
        least, most = 0.0, inf
        if self.fields == ("gain",):
            ratio = model.sizes([undone])[0] / model.possible
            most = LARGEST * max(1.0, float(ratio[list(motors)].max()))
        elif self.fields == ("ratio",):
            (motor,) = motors
            span = float(model.span[undone.positions[motor]]) / abs(undone.ratio[motor])
            least = span / max(span, TURN)
        possible = [size for size in self.sizes if least <= size <= most]
        return np.outer(self.signs, possible).ravel()


class Mistaken(NamedTuple):
    """A mistake that is to be called something."""

    names: tuple[str, ...]  # of its motors; empty of all
    size: float
    reach: float  # half of its 95 % interval
    cause: Cause | None
    own: OwnGains | None  # sizes of its motors, where each has its own
    model: Evidence
    found: Explanation  # how the log was explained before

    @property
    def listed(self) -> str:
        return " and ".join(self.names) or "all motors"

    @property
    def factor(self) -> float:
        """The size, of a cause exactly."""
        return float(f"{self.size:.3g}") if self.cause is None else self.cause[0]

    @property
    def sized(self) -> str:
        if self.own is not None:
            return self._sized_alone(self.own)
        if not self.reach:
            return ""
        return f"{self.size:.3g} ± {self.reach:.2g} times as much as expected; "

    def _sized_alone(self, own: OwnGains) -> str:
        said = list[str]()
        for name, k in zip(self.names, own.motors, strict=True):
            size, reach = own.gains[k], own.reach[k]
            known = f" ± {abs(size) * reach:.2g}" * bool(0 < reach < inf)
            said.append(f"{name} {'about ' * bool(reach == inf)}{size:.3g}{known}")
        unknown = np.flatnonzero((own.gains == 1) & (own.reach == inf)).tolist()
        others = [self.model.names[k] for k in unknown]
        of = f"; that of {first_of(others, 1)} does not show" if others else ""
        return f"{', '.join(said)} times as much as expected{of}; "

    def scale(self, key: str) -> str:
        """What to set so that values are divided by the factors.

        What is set for forces undoes what was found before, too.
        """
        scales, log = dict[str, float](), self.model.log
        if key == "force_scale":
            scales |= {} if log is None else log.force_scales
            for motor, gain in zip(self.model.names, self.found.undone.gain, strict=True):
                if gain != 1:
                    scales[motor] = scales.get(motor, 1.0) / gain
        motors = self.names or self.model.names
        sizes = [self.factor] * len(motors)
        if self.own is not None:
            sizes = self.own.gains[list(self.own.motors)].tolist()
        for name, size in zip(motors, sizes, strict=True):
            undo = 1 / size if self.cause else float(f"{1 / size:.3g}")
            scales[name] = scales.get(name, 1.0) * undo
        found = [f"{name}: {x:.7g}" for name, x in scales.items() if name in motors or x != 1.0]
        given = "{" + ", ".join(found) + "}"
        if not self.names and len(set(scales.values())) == 1:
            given = f"{scales[motors[0]]:.7g}"
        return f"set {key}: {given} in the mapping"


def _force(one: Mistaken) -> Called:
    if one.reach > KNOWN * abs(one.size):  # small, however small
        most = 100 * (abs(one.size) + one.reach)
        title = f"the force of {one.listed} is below {most:.2g} % of what is expected"
        return (title, one.sized, "check its column and its unit: its size is not known")
    do = one.scale("force_scale")
    if len(one.model.names) == 1 and one.cause == (-1.0, WRONG_SIGN):  # turned positions look alike
        do += f", or position_scale: {{{one.listed}: -1}} where it is its position that is turned"
    return _scaled(one, f"the force of {one.listed}", "has", "is", "its", do)


def _own(one: Mistaken) -> Called:
    own, do = one.own, one.scale("force_scale")
    assert own is not None
    if (own.gains[list(own.motors)] == -1).all():
        return (f"forces of {first_of(one.names, 1)} have the {WRONG_SIGN}", "", do)
    if own.relative:
        do += ", times one number for all where the file's masses are off alike"
    title = f"forces of {first_of(one.names, 1)} have gains of their own"
    return (title, one.sized, do)


def _position(one: Mistaken) -> Called:
    do = f"{one.scale('position_scale')}, times what it has"
    return _scaled(one, f"the positions of {one.listed}", "have", "are", "their", do)


def _scaled(one: Mistaken, what: str, has: str, is_: str, its: str, do: str) -> Called:
    """Signals that are scaled: by which factor, or why."""
    size, words = one.cause or (1.0, "")
    if not words:
        # Bodies and forces times the same number move alike: only known masses tell them apart.
        by = "" if one.names else ", as its size is known no better than the file's masses"
        do = f"check {its} unit{by}, or {do}"
        return (f"{what} {is_} scaled by {one.factor:g}", one.sized, do)
    turned = " with the wrong sign" if size < 0 else ""
    said = f"{has} the {words}" if words == WRONG_SIGN else f"{is_} {words}{turned}"
    return (f"{what} {said}", one.sized, do)


def _zero(one: Mistaken) -> Called:
    (name,) = one.names
    unit, length = one.model.robot.units(name)[0], one.model.lengths[one.model.names.index(name)]
    off, reach = one.factor * length, one.reach * length
    return (
        f"zero of {name} is off by {off:.3g} {unit}",
        f"{one.size * length:.3g} ± {reach:.2g} {unit}; ",
        f"set position_offset: {{{name}: {-off:.3g}}} in the mapping, plus one that it has",
    )


def _time(one: Mistaken) -> Called:
    size, least, most = one.factor, "", ""
    if one.reach > KNOWN * abs(one.size):  # forces show only that inertia is missing
        size, least, most = one.size + one.reach, "at least ", " or less"
    how = f"{least}{max(size, 1 / size):.3g} times too {'long' if size > 1 else 'short'}"
    do = f"multiply its times by {1 / size:.3g}{' or more' * bool(most)}"
    if (log := one.model.log) is not None:
        rate = log.rate(max(log.parts(), key=lambda p: p.stop - p.start))
        do = f"set rate: {rate * size:.6g} in the mapping{most}, or {do}"
    return (f"the time axis is {how}", one.sized, do)


def _exchanged(*what: str) -> Callable[[Mistaken], Called]:
    def called(one: Mistaken) -> Called:
        keys = " and ".join(key[:-1] for key in what)
        title = f"the {' and '.join(what)} of {one.listed} are exchanged"
        return (title, "", f"exchange their columns under {keys} in the mapping")

    return called


GAINS, BOTH = tuple(np.logspace(-4, 4, 17).tolist()), (1.0, -1.0)
WRONG_SIGN = "wrong sign"
UNITS = ((1e3, "in mN m"), (100.0, "in N cm"), (1e-3, "in kN m"))
FORCE_CAUSES = ((-1.0, WRONG_SIGN), *UNITS, *((-size, words) for size, words in UNITS))
DEGREE = pi / 180
POSITION_CAUSES = (
    (-1.0, WRONG_SIGN),
    *((1 / DEGREE, "in degrees"), (DEGREE, "converted from degrees, which they were not")),
    *((1e3, "in mm"), (0.5 / pi, "in turns")),
    *((factor, "") for factor in (2.0, 0.5, 4.0, 0.25)),  # edges of an encoder, counted otherwise
)
RATIOS = tuple(np.logspace(-2, 2, 9).tolist())
TIME_CAUSES = tuple((factor, "") for factor in (2.0, 0.5, 5.0, 0.2, 10.0, 0.1, 60.0, 1 / 60))
TIMES = tuple(np.logspace(-2, 2, 17).tolist())
ZERO_CAUSES = tuple((turn * pi, "") for turn in (0.5, -0.5, 1.0, -1.0))
ZEROS = tuple(np.geomspace(0.05, 4.0, 7).tolist())
TWICE, ZERO_OFF = (0.5, 2.0), 0.3
PLACES = ("positions", "ratio", "zero")  # of what belongs to positions
# Bodies that are off by half, or of another material, are no gains; accelerations hang on the
# square of the time axis; zeros are in rad or characteristic lengths.
KINDS = {
    "gain": MistakeKind(
        *(("gain",), 1, _force, GAINS, BOTH, FORCE_CAUSES),
        least=1.25,
        usual=TWICE,
        hidden="force scales of",
    ),
    # Of a motor whose bodies hardly determine its gain, by friction that would give energy.
    "sign": MistakeKind(("gain",), 1, _force, (), (-1.0,), FORCE_CAUSES),
    "common_gain": MistakeKind(("gain",), 0, _force, GAINS, BOTH, FORCE_CAUSES, 0.9, 4.0),
    "own gains": MistakeKind(("gain",), 0, _own, alone=True),
    "factor": MistakeKind(
        *(("time",), 0, _time, TIMES, (1.0,), TIME_CAUSES),
        least=1.3,
        usual=TWICE,
        hidden="its time axis",
    ),
    "ratio": MistakeKind(("ratio",), 1, _position, RATIOS, BOTH, POSITION_CAUSES, least=1.5),
    # A sign alone, where the size hardly matters.
    "turned": MistakeKind(("ratio",), 1, _position, (), (-1.0,), POSITION_CAUSES),
    "all turned": MistakeKind(("ratio",), 0, _position, (), (-1.0,), POSITION_CAUSES),
    "zero": MistakeKind(
        *(("zero",), 1, _zero, ZEROS, BOTH, ZERO_CAUSES, 0.02, 0.05),
        usual=(-ZERO_OFF, ZERO_OFF),
        hidden="zeros of",
    ),
    "forces": MistakeKind(("forces", "gain"), 2, _exchanged("forces")),
    "positions": MistakeKind(PLACES, 2, _exchanged("positions")),
    "positions and forces": MistakeKind(
        (*PLACES, "forces", "gain"), 2, _exchanged("positions", "forces")
    ),
}
