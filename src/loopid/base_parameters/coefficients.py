"""Coefficients by name: which lengths of the robot a coefficient of a base parameter is made of.

A coefficient that equals a length between the two links of its term is named by it. Any other
length, and any two lengths together, need more digits that agree than an accident would give them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.base_parameters.base import BaseParameters
from loopid.base_parameters.candidates import EQUAL, Candidates, spacing
from loopid.base_parameters.forms import FORMS, CoefficientName
from loopid.lengths import NamedLength
from loopid.parameters import KINDS, Parameter

# Ratios of small whole numbers come from counting, say three equal legs, not from lengths.
SMALL = 3
PLAIN = tuple({p / q for p in range(1, SMALL + 1) for q in range(1, SMALL + 1)})
# Accidents to be expected among all the candidates tried for a coefficient, at most.
ACCIDENTS = 0.05
# Lengths that are looked at, the first ones, where so many are taken together.
MOST = {1: None, 2: 200}
# What is tried in turn: how many lengths together, each of how many of the term's links at least.
STAGES = ((1, 1), (1, 0), (2, 1), (2, 0))


@checked
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


_Known = tuple[_Term, CoefficientName]


def _repeated(term: _Term, known: list[_Known]) -> CoefficientName | None:
    return next((name for other, name in known if term.repeats(other)), None)


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
        found: dict[str, CoefficientName] = {}
        known: list[_Known] = []
        for j in np.flatnonzero(row).tolist():
            term = _Term(float(row[j]), base.parameters[leader], base.parameters[j])
            name = self.name(term, known)
            if name is not None:
                found[term.folded.label] = name
                known.append((term, name))
        return found

    def name(self, term: _Term, known: list[_Known]) -> CoefficientName | None:
        """Name of the coefficient of a term, in a sum of which some terms are known."""
        if not term.needs_name:
            return None
        shared = sum(map(self._part, term.links), np.zeros(len(self.lengths), dtype=np.int64))
        used = np.isin(
            np.arange(len(shared)), [self._index[x] for _, n in known for x in n.lengths]
        )
        return (
            self._obvious(term, shared, used)
            or self._unlikely(term, shared, used)
            or _repeated(term, known)
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
