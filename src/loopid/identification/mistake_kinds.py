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
from loopid.findings import Finding
from loopid.identification.evidence import STRANGE, Evidence, Explanation, Undone
from loopid.identification.own_gains import OwnGains
from loopid.numbers import number

# Half of the 95 % interval at most, as a part of the size: a size that is not known is none.
KNOWN = 0.5
# Part of the forces, less friction, that may be left of a motor once its mistake is undone: a robot
# file that explains no shape shows no mistake. Less of a factor that nobody has a cause for: a
# missing force has any, but none takes all of a force away but for a tenth of the same shape.
SHAPE, FACTOR_SHAPE, SMALL_SHAPE, SMALL = 0.4, 0.15, 0.6, 0.1
# Errors of motors that were exchanged, or of one that lacks inertia, over those before, at most.
BETTER = 0.8
# Part of the shape of forces that the bodies carry at least, once a gain is undone.
CARRIED = 0.5
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
    call: Callable[[Find, Evidence, Explanation], Called]
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


class Find(NamedTuple):
    """A mistake at its most likely size, and how well that is known."""

    kind: str
    motors: Motors
    after: Explanation  # once it is undone
    evidence: float  # less what is lost by a choice of size and motor
    size: float = 1.0
    reach: float = 0.0  # half of the 95 % interval
    own: OwnGains | None = None  # where each motor has a size of its own
    lost: float = 0.0

    @property
    def cause(self) -> Cause | None:
        return KINDS[self.kind].cause(self.size, self.reach)

    @property
    def of_gain(self) -> bool:
        return KINDS[self.kind].fields == ("gain",)

    def worth(self, found: Explanation) -> bool:
        """Whether a size is known and not as good as none; or errors of all its motors fall."""
        if self.own is not None:
            return self.own.wrong > 1
        kind, size, reach = KINDS[self.kind], self.size, self.reach
        if not kind.sizes:
            worse = self.after.error > BETTER * found.error
            return not worse[list(self.motors)].any()
        if kind.added:
            return abs(size) - reach > kind.least
        usual = size - reach <= kind.least and 1 / kind.least <= size + reach
        usual |= self.of_gain and self._carried_by_others(found)
        known = reach <= KNOWN * abs(size)
        # Of a time axis that is too short, inertia that a motor lacks shows how much at least.
        if self.kind == "factor" and size + reach < 1:
            known |= bool((self.after.error < BETTER * found.error).any())
        return (known or self.small) and not usual

    def _carried_by_others(self, found: Explanation) -> bool:
        """Whether a gain makes forces that were explained ones that no body carries, as springs."""
        own, after = list(self.motors), self.after
        large = found.error > STRANGE * found.shape
        carried = after.carried > CARRIED * after.shape
        return not (large | carried)[own].any()

    @property
    def small(self) -> bool:
        """Whether forces of a motor are a small part of what is expected, however small."""
        return self.of_gain and 0 < abs(self.size) + self.reach < SMALL

    @property
    def shape(self) -> float:
        """The part of the shape of its forces that may be left at most."""
        if self.small:
            return SMALL_SHAPE
        # Of a gain, no missing force looks alike where people have a cause for its size.
        caused = not self.of_gain or self.cause is not None
        if self.own is not None:
            caused = bool((self.own.gains < 0).any())
        return SHAPE if caused else FACTOR_SHAPE

    def mended(self, undone: Undone) -> Undone:
        """With the mistake undone, too, as it is advised: exactly by a cause."""
        kind, cause = KINDS[self.kind], self.cause
        if self.own is not None:
            for k in self.motors:
                undone = kind.undone(undone, (k,), 1 / float(f"{1 / self.own.gains[k]:.3g}"))
            return undone
        return kind.undone(undone, self.motors, self.size if cause is None else cause[0])

    def finding(self, model: Evidence, found: Explanation) -> Finding:
        """In words, against how the log was explained before."""
        title, size, do = KINDS[self.kind].call(self, model, found)
        after, before = (
            100 * one.error / model.sizes([one.undone])[0] for one in (self.after, found)
        )
        # Forces of a motor show positions of another: those of the motor that gains most count.
        shown = model.present if KINDS[self.kind].assembled else self.motors
        k = max(shown, key=lambda k: float(before[k] - after[k]))
        of = "" if k in self.motors else f" of {model.names[k]}"
        why = (
            f"{size}undone, errors are {number(float(after[k]), 2)} % of the force{of} "
            f"instead of {number(float(before[k]), 3)} % "
            f"(evidence e^{self.evidence - found.evidence:.0f})"
        )
        return Finding("mistake", title, why, do)

    @property
    def factor(self) -> float:
        """The size, of a cause exactly."""
        return float(f"{self.size:.3g}") if self.cause is None else self.cause[0]

    @property
    def sized(self) -> str:
        """The size with its interval, in words."""
        if not self.reach:
            return ""
        return f"{self.size:.3g} ± {self.reach:.2g} times as much as expected; "

    def names(self, model: Evidence) -> tuple[str, ...]:
        """Of its motors; none of all."""
        every = not (KINDS[self.kind].motors or self.own)
        return () if every else tuple(model.names[k] for k in self.motors)

    def whose(self, model: Evidence) -> str:
        return " and ".join(self.names(model)) or "all motors"

    def scale(self, key: str, model: Evidence, found: Explanation) -> str:
        """What to set so that values are divided by the factors.

        What is set for forces undoes what was found before, too.
        """
        scales = dict[str, float]()
        if key == "force_scale":
            scales |= {} if model.log is None else model.log.force_scales
            for motor, gain in zip(model.names, found.undone.gain, strict=True):
                if gain != 1:
                    scales[motor] = scales.get(motor, 1.0) / gain
        motors = self.names(model) or model.names
        sizes = [self.factor] * len(motors)
        if self.own is not None:
            sizes = self.own.gains[list(self.own.motors)].tolist()
        for name, size in zip(motors, sizes, strict=True):
            undo = 1 / size if self.cause else float(f"{1 / size:.3g}")
            scales[name] = scales.get(name, 1.0) * undo
        said = [f"{name}: {x:.7g}" for name, x in scales.items() if name in motors or x != 1.0]
        given = "{" + ", ".join(said) + "}"
        if not self.names(model) and len(set(scales.values())) == 1:
            given = f"{scales[motors[0]]:.7g}"
        return f"set {key}: {given} in the mapping"


def _force(one: Find, model: Evidence, found: Explanation) -> Called:
    whose = one.whose(model)
    if one.reach > KNOWN * abs(one.size):  # small, however small
        most = 100 * (abs(one.size) + one.reach)
        title = f"the force of {whose} is below {most:.2g} % of what is expected"
        return title, one.sized, "check its column and its unit: its size is not known"
    do = one.scale("force_scale", model, found)
    if len(model.names) == 1 and one.cause == (-1.0, WRONG_SIGN):  # turned positions look alike
        do += f", or position_scale: {{{whose}: -1}} where it is its position that is turned"
    return _scaled(one, f"the force of {whose}", "has", "is", "its", do)


def _own(one: Find, model: Evidence, found: Explanation) -> Called:
    own, do, names = one.own, one.scale("force_scale", model, found), one.names(model)
    assert own is not None
    whose = f"forces of {first_of(names, 1)} have"
    if (own.gains[list(own.motors)] == -1).all():
        return f"{whose} the {WRONG_SIGN}", "", do
    if own.relative:
        do += ", times one number for all where the file's masses are off alike"
    said = list[str]()
    for name, k in zip(names, own.motors, strict=True):
        size, reach = own.gains[k], own.reach[k]
        known = f" ± {abs(size) * reach:.2g}" * bool(0 < reach < inf)
        said.append(f"{name} {'about ' * bool(reach == inf)}{size:.3g}{known}")
    unknown = np.flatnonzero((own.gains == 1) & (own.reach == inf)).tolist()
    others = first_of([model.names[k] for k in unknown], 1)
    of = f"; that of {others} does not show" * bool(unknown)
    return f"{whose} gains of their own", f"{', '.join(said)} times as much as expected{of}; ", do


def _position(one: Find, model: Evidence, found: Explanation) -> Called:
    do = f"{one.scale('position_scale', model, found)}, times what it has"
    return _scaled(one, f"the positions of {one.whose(model)}", "have", "are", "their", do)


def _scaled(one: Find, what: str, has: str, is_: str, its: str, do: str) -> Called:
    """Signals that are scaled: by which factor, or why."""
    size, words = one.cause or (1.0, "")
    if not words:
        # Bodies and forces times the same number move alike: only known masses tell them apart.
        of_all = ", as its size is known no better than the file's masses"
        do = f"check {its} unit{of_all * (not KINDS[one.kind].motors)}, or {do}"
        return f"{what} {is_} scaled by {one.factor:g}", one.sized, do
    turned = " with the wrong sign" if size < 0 else ""
    said = f"{has} the {words}" if words == WRONG_SIGN else f"{is_} {words}{turned}"
    return f"{what} {said}", one.sized, do


def _zero(one: Find, model: Evidence, _: Explanation) -> Called:
    name, length = model.names[one.motors[0]], model.lengths[one.motors[0]]
    unit, off, reach = model.robot.units(name)[0], one.factor * length, one.reach * length
    return (
        f"zero of {name} is off by {off:.3g} {unit}",
        f"{one.size * length:.3g} ± {reach:.2g} {unit}; ",
        f"set position_offset: {{{name}: {-off:.3g}}} in the mapping, plus one that it has",
    )


def _time(one: Find, model: Evidence, _: Explanation) -> Called:
    size, least, most = one.factor, "", ""
    if one.reach > KNOWN * abs(one.size):  # forces show only that inertia is missing
        size, least, most = one.size + one.reach, "at least ", " or less"
    how = f"{least}{max(size, 1 / size):.3g} times too {'long' if size > 1 else 'short'}"
    do = f"multiply its times by {1 / size:.3g}{' or more' * bool(most)}"
    if (log := model.log) is not None:
        rate = log.rate(max(log.parts(), key=lambda p: p.stop - p.start))
        do = f"set rate: {rate * size:.6g} in the mapping{most}, or {do}"
    return f"the time axis is {how}", one.sized, do


def _exchanged(*what: str) -> Callable[[Find, Evidence, Explanation], Called]:
    keys, whats = (" and ".join(key[:-1] for key in what)), " and ".join(what)
    do = f"exchange their columns under {keys} in the mapping"
    return lambda one, model, _: (f"the {whats} of {one.whose(model)} are exchanged", "", do)


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
