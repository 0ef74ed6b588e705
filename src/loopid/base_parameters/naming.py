"""How base parameters read: sums of labels, with coefficients named by lengths of the robot.

Folding a parameter with d powers of length in its unit into one with b multiplies it by
length^(b - d). Parallel axes give lengths and their squares, planar loops give ratios. A
coefficient that equals a length between the two links of its term is named by it. Any other
length, and any two lengths together, need more digits that agree than an accident would give them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from loopid.arguments import (
    BoolArray,
    FloatArray,
    IntArray,
    checked,
)
from loopid.errors import OptionError
from loopid.parameters import (
    KINDS,
    NamedLength,
    Parameter,
)

if TYPE_CHECKING:
    from loopid.base_parameters.base import BaseParameters

SHOWN = 4  # significant digits, for reading only
# Relative difference that round-off may leave between equal numbers, and the significant digits
# that a number is looked at for.
EQUAL, DIGITS = 1e-9, 9
# Ratios of small whole numbers come from counting, say three equal legs, not from lengths.
PLAIN = tuple({p / q for p in range(1, 4) for q in range(1, 4)})
# Accidents to be expected among all the candidates tried for a coefficient, at most.
ACCIDENTS = 0.05
# Lengths that are looked at, the first ones, where so many are taken together.
MOST = {1: None, 2: 200}
# What is tried in turn: how many lengths together, each of how many of the term's links at least.
STAGES = ((1, 1), (1, 0), (2, 1), (2, 0))

Value = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Form:
    """One way of making a number of two signed lengths in m, or of the first alone.

    ``text`` and ``negative`` are how it reads, and how its negative does, with ``{0}`` and ``{1}``
    for the symbols.
    """

    text: str
    negative: str
    value: Value


def _product(text: str, value: Value) -> Form:
    return Form(text, f"-{text}", value)


_ONE = {
    -2: (_product("1/{0}²", lambda a, _: 1 / a**2),),
    -1: (_product("1/{0}", lambda a, _: 1 / a), _product("1/(2 {0})", lambda a, _: 0.5 / a)),
    1: (_product("{0}", lambda a, _: a), _product("2 {0}", lambda a, _: 2 * a)),
    2: (_product("{0}²", lambda a, _: a**2), _product("2 {0}²", lambda a, _: 2 * a**2)),
}
_TWO = {
    -2: (_product("1/({0} {1})", lambda a, b: 1 / (a * b)),),
    -1: (_product("{0}/{1}²", lambda a, b: a / b**2),),
    0: (
        _product("{0}/{1}", lambda a, b: a / b),
        _product("{0}²/{1}²", lambda a, b: (a / b) ** 2),
        Form("1 + {0}/{1}", "-1 - {0}/{1}", lambda a, b: 1 + a / b),
        Form("1 - {0}/{1}", "{0}/{1} - 1", lambda a, b: 1 - a / b),
    ),
    1: (
        _product("{0}²/{1}", lambda a, b: a**2 / b),
        Form("{0} + {1}", "-{0} - {1}", lambda a, b: a + b),
        Form("{0} - {1}", "{1} - {0}", lambda a, b: a - b),
        _product("2 ({0} + {1})", lambda a, b: 2 * (a + b)),
        _product("2 ({0} - {1})", lambda a, b: 2 * (a - b)),
    ),
    2: (
        _product("{0} {1}", lambda a, b: a * b),
        _product("2 {0} {1}", lambda a, b: 2 * a * b),
        Form("{0}² + {1}²", "-{0}² - {1}²", lambda a, b: a**2 + b**2),
        Form("{0}² - {1}²", "{1}² - {0}²", lambda a, b: a**2 - b**2),
        _product("({0} + {1})²", lambda a, b: (a + b) ** 2),
        _product("({0} - {1})²", lambda a, b: (a - b) ** 2),
    ),
}
# By the number of lengths, and the power of length that they make; the plainest comes first.
FORMS = {1: _ONE, 2: _TWO}


@dataclass(frozen=True)
class CoefficientName:
    """What a coefficient is, in lengths of the robot.

    Attributes
    ----------
    form : Form
    lengths : tuple of NamedLength
        Those in the form.
    negated : bool
        Whether the coefficient is the negative of the form.
    """

    form: Form
    lengths: tuple[NamedLength, ...]
    negated: bool

    @property
    def text(self) -> str:
        """Equal to the coefficient, sign included: ``-x(platform_B2) y(platform_B2)``."""
        return self._filled(self.form.negative if self.negated else self.form.text)

    def equation(self, coefficient: float, digits: int) -> str:
        """Number and name, without minus where the form has none: ``0.04432 = x(B2) y(B2)``."""
        number = -coefficient if self.negated else coefficient
        return f"{number:.{digits}g} = {self._filled(self.form.text)}"

    def _filled(self, text: str) -> str:
        return text.format(*(length.symbol for length in self.lengths))


@checked
def expression(
    terms: Mapping[str, float],
    digits: int = SHOWN,
    names: Mapping[str, CoefficientName] | None = None,
) -> str:
    """Write terms as a sum, ``platform.mx + 0.1928 leg2_stem.m, where 0.1928 = x(platform_B2)``.

    Parameters
    ----------
    terms : mapping
        Parameter label to coefficient.
    digits : int
        Significant digits of the coefficients; for reading only.
    names : mapping, optional
        Parameter label to what its coefficient is, from ``name_coefficients``.

    Raises
    ------
    OptionError
        When there are no digits.
    """
    if digits < 1:
        raise OptionError(f"digits must be a whole number from 1 on, not {digits}")
    where = ", ".join(equations(terms, names or {}, digits))
    return f"{_sum(terms, digits)}, where {where}" if where else _sum(terms, digits)


def equations(
    terms: Mapping[str, float], names: Mapping[str, CoefficientName], digits: int = SHOWN
) -> list[str]:
    """What the coefficients of a sum are, ``0.1928 = x(platform_B2)``, each equation once.

    Parameters
    ----------
    terms, names, digits
        As in ``expression``.
    """
    named = (names[label].equation(terms[label], digits) for label in terms if label in names)
    return list(dict.fromkeys(named))


def _sum(terms: Mapping[str, float], digits: int) -> str:
    parts: list[str] = []
    for label, coefficient in terms.items():
        size = f"{abs(coefficient):.{digits}g}"
        factor = "" if size == "1" else f"{size} "
        sign = "-" if coefficient < 0 else "+"
        if parts:
            parts.append(f" {sign} {factor}{label}")
        else:
            parts.append(f"{'-' if sign == '-' else ''}{factor}{label}")
    return "".join(parts)


def name_coefficients(
    base: BaseParameters, lengths: Iterable[NamedLength]
) -> tuple[dict[str, CoefficientName], ...]:
    """Name the coefficients that are lengths of the robot, or made of them.

    Parameters
    ----------
    base : BaseParameters
    lengths : iterable of NamedLength
        None of them zero; in order of preference.

    Returns
    -------
    tuple of dict
        For each base parameter its named terms: label to name. Terms whose coefficient no length
        explains are left out.
    """
    namer = _Namer(lengths)
    return tuple(
        namer.names(base, int(leader), row)
        for leader, row in zip(base.base, base.matrix, strict=True)
    )


@dataclass(frozen=True)
class _Term:
    """A coefficient and the parameters it joins."""

    value: float
    leader: Parameter
    folded: Parameter

    @property
    def power(self) -> int:
        return self.leader.length_power - self.folded.length_power

    @property
    def links(self) -> set[str]:
        return {self.leader.link, self.folded.link}

    @property
    def needs_name(self) -> bool:
        standard = {self.leader.kind, self.folded.kind} <= set(KINDS)
        plain = PLAIN if self.power == 0 else (1.0,)
        return standard and not any(math.isclose(abs(self.value), p, rel_tol=EQUAL) for p in plain)

    def repeats(self, other: _Term) -> bool:
        """Whether it is the same number with the same unit."""
        return self.power == other.power and math.isclose(self.value, other.value, rel_tol=EQUAL)


class _Namer:
    """Finds names, and keeps the candidates of each power of length."""

    def __init__(self, lengths: Iterable[NamedLength]) -> None:
        self.lengths = tuple(lengths)
        self._index = {length: k for k, length in enumerate(self.lengths)}
        self._candidates: dict[tuple[int, int], Candidates] = {}
        self._parts: dict[str, IntArray] = {}

    def names(
        self, base: BaseParameters, leader: int, row: FloatArray
    ) -> dict[str, CoefficientName]:
        """Names in one base parameter; what has named one term is preferred in the next."""
        known: list[tuple[_Term, CoefficientName]] = []
        used = np.zeros(len(self.lengths), dtype=bool)
        for j in np.flatnonzero(row).tolist():
            term = _Term(float(row[j]), base.parameters[leader], base.parameters[j])
            if term.needs_name and (name := self._name(term, known, used)):
                known.append((term, name))
                used[[self._index[length] for length in name.lengths]] = True
        return {term.folded.label: name for term, name in known}

    def _name(
        self, term: _Term, known: list[tuple[_Term, CoefficientName]], used: BoolArray
    ) -> CoefficientName | None:
        """Name of the coefficient of a term, in a sum of which some terms are known."""
        shared = sum(map(self._part, term.links), np.zeros(len(self.lengths), dtype=np.int64))
        repeated = (name for other, name in known if term.repeats(other))
        return (
            self._obvious(term, shared, used)
            or self._unlikely(term, shared, used)
            or next(repeated, None)
        )

    def _obvious(self, term: _Term, shared: IntArray, used: BoolArray) -> CoefficientName | None:
        """A length that joins the links of the term, in its plainest form.

        In a term of one link its lengths must be fewer than the numbers with as many digits.
        """
        links = len(term.links)
        if links == 1 and np.count_nonzero(shared) * spacing(term.value) > 1:
            return None
        name = self._of(term.power, 1).find(term.value, shared, used, least=links)
        return name if name and name.form is FORMS[1][term.power][0] else None

    def _unlikely(self, term: _Term, shared: IntArray, used: BoolArray) -> CoefficientName | None:
        """The first name that so many candidates would hardly have given by accident."""
        tried = 0
        for together, least in STAGES:
            candidates = self._of(term.power, together)
            tried += candidates.count(shared, least)
            if tried * spacing(term.value) > ACCIDENTS:
                continue
            name = candidates.find(term.value, shared, used, least)
            if name is not None:
                return name
        return None

    def _of(self, power: int, together: int) -> Candidates:
        if (power, together) not in self._candidates:
            forms = FORMS[together].get(power, ())
            lengths = self.lengths[: MOST[together]]
            self._candidates[power, together] = Candidates(forms, lengths, together)
        return self._candidates[power, together]

    def _part(self, link: str) -> IntArray:
        """1 for each length that is part of a link, 0 for others; shape (n,)."""
        if link not in self._parts:
            self._parts[link] = np.array([link in x.links for x in self.lengths], dtype=np.int64)
        return self._parts[link]


class Candidates:
    """The numbers that forms make of one length, or of two ``together``, by size.

    Lengths are in order of preference.
    """

    def __init__(
        self, forms: Sequence[Form], lengths: Sequence[NamedLength], together: int
    ) -> None:
        self.forms, self.lengths, self.together = forms, lengths, together
        chosen = np.array(list(permutations(range(len(lengths)), together)), dtype=np.int64)
        chosen = chosen.reshape(-1, together).T
        numbers = np.array([length.value for length in lengths])[chosen]
        values = np.array([form.value(numbers[0], numbers[-1]) for form in forms]).ravel()
        order = np.argsort(np.abs(values))
        self.values, self.sizes = values[order], np.abs(values)[order]
        self.simplicity = np.array([len(form.text) for form in forms], dtype=np.int64)
        self.form = np.repeat(np.arange(len(forms)), chosen.shape[1])[order]
        self.chosen = np.tile(chosen, len(forms))[:, order]

    def count(self, shared: IntArray, least: int) -> int:
        """How many candidates ``find`` looks at."""
        among = int(np.count_nonzero(shared[: len(self.lengths)] >= least))
        return len(self.forms) * math.perm(among, self.together)

    def find(
        self, value: float, shared: IntArray, used: BoolArray, least: int
    ) -> CoefficientName | None:
        """Name a value by what has its size and reads shortest.

        ``shared`` (n,) is of how many of the term's links each length is a part: many are
        preferred, and fewer than ``least`` left out. ``used`` (n,) lengths are preferred where
        nothing else decides.
        """
        size = abs(value)
        at = slice(*np.searchsorted(self.sizes, (size * (1 - EQUAL), size * (1 + EQUAL))))
        fits = at.start + np.flatnonzero((shared[self.chosen[:, at]] >= least).all(axis=0))
        if not len(fits):
            return None
        picked, form, negated = self.chosen[:, fits], self.form[fits], self.values[fits] * value < 0
        links, unused = shared[picked], ~used[picked]
        keys = (self.simplicity[form], -links.sum(axis=0), negated, unused.sum(axis=0), *picked)
        k = np.lexsort(keys[::-1])[0]
        lengths = tuple(self.lengths[j] for j in picked[:, k])
        return CoefficientName(self.forms[form[k]], lengths, bool(negated[k]))


def spacing(value: float) -> float:
    """Relative distance between numbers with as many digits as a value, not zero, has.

    1/M of the least integer M with ``value`` = ±M 10^k, at least twice ``EQUAL``.
    """
    size = abs(value)
    exponent = math.floor(math.log10(size))
    for decimals in range(DIGITS):
        mantissa = size * 10.0 ** (decimals - exponent)
        if abs(mantissa - round(mantissa)) <= EQUAL * mantissa:
            return max(1.0 / round(mantissa), 2 * EQUAL)
    return 2 * EQUAL
