"""Fronts: what the selections inside a set of vectors mean to the rest, worst ones left away.

To select D with all eigenvalues of X_D X_Dᵀ above t is to make Σ (x_i - t) x_i x_iᵀ positive
definite (x_i = 1 in D, else 0). What a set C of rows contributes is a quadratic form; minimised
over the null vectors inside C it becomes its *state*, a w x w form on the boundary. Eigenvalues
below a cap u are a second form of the same kind, Σ (u - x_i) x_i x_iᵀ. A state is worthless if
another one of the same count exceeds it. Derivation in docs/derivations.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.base_parameters.search.branches import Branch
from loopid.base_parameters.search.conflicts import ZERO_PIVOT
from loopid.base_parameters.search.loewner import maximal, room, sums
from loopid.base_parameters.search.threshold import Budget

# Pairs of states between two looks at the budget.
MOST_PAIRS = 1 << 21
# States that wait to be thinned; larger fronts are thinned as they grow.
MOST_WAITING = 1 << 17

Change = Callable[["Front"], "Front"]


@dataclass(frozen=True)
class Front:
    """States of a set of vectors.

    Attributes
    ----------
    forms : FloatArray
        (N, kinds, w, w): the threshold's form, then the cap's if there is one.
    excess : IntArray
        (N,), selected vectors beyond the dimension of the null vectors inside: 0 ... w.
    origins : IntArray
        (N, 2), the states of the two children that a state is made of; -1 for a bound of many.
    """

    forms: FloatArray
    excess: IntArray
    origins: IntArray

    def __len__(self) -> int:
        return len(self.excess)

    @property
    def exact(self) -> bool:
        """Whether every state belongs to a selection."""
        return bool((self.origins >= 0).all())

    def only(self, chosen: IntArray | BoolArray) -> Front:
        """Some of the states."""
        return Front(self.forms[chosen], self.excess[chosen], self.origins[chosen])

    def by_excess(self) -> list[IntArray]:
        """Indices of the states of each excess."""
        return [np.flatnonzero(self.excess == value) for value in np.unique(self.excess)]


@dataclass(frozen=True)
class Range:
    """The eigenvalues that are asked for: above ``above`` and, if given, below ``below``."""

    above: float
    below: float | None = None

    def contains(self, other: Range) -> bool:
        """Whether another range is part of this one, and has forms of the same kinds."""
        if self.below is None or other.below is None:
            return self.below is other.below and self.above <= other.above
        return self.above <= other.above and self.below >= other.below

    @property
    def selected(self) -> FloatArray:
        """Weight (kinds,) of a vector in the selection."""
        caps = [] if self.below is None else [self.below - 1]
        return np.array([1 - self.above, *caps])

    @property
    def left(self) -> FloatArray:
        """Weight (kinds,) of a vector that is not."""
        caps = [] if self.below is None else [self.below]
        return np.array([-self.above, *caps])

    @property
    def most(self) -> FloatArray:
        """The larger of both."""
        return np.maximum(self.selected, self.left)


def joined(fronts: list[Front]) -> Front:
    """All states of several fronts."""
    return Front(
        np.concatenate([front.forms for front in fronts]),
        np.concatenate([front.excess for front in fronts]),
        np.concatenate([front.origins for front in fronts]),
    )


def single(branch: Branch, wanted: Range) -> Front:
    """A vector left, or selected; its only direction is shared with the rest."""
    weights = np.stack([wanted.left, wanted.selected]) * branch.weights[0]
    return Front(weights[..., None, None], np.array([0, 1]), np.array([[0, 0], [1, 1]]))


def combine(
    maps: tuple[FloatArray, FloatArray],
    fronts: tuple[Front, Front],
    excess: IntArray,
    width: int,
    changes: tuple[Change, Change],
    budget: Budget,
) -> Front:
    """Every pair of states of two sets, where it is positive definite inside both together.

    Parameters
    ----------
    maps : tuple of FloatArray
        (w, m) each: coordinates of the sets from common ones, of which the first ``width`` stay.
    fronts : tuple of Front
    excess : IntArray
        (N_a, N_b), the excess of every pair.
    width : int
        Pairs with an excess outside 0 ... width cannot be completed.
    changes : tuple of callable
        What leaves away states that cannot be completed, and what thins a front.
    budget : Budget
    """
    possible, thinned = changes
    first, second = (E.T @ front.forms @ E for E, front in zip(maps, fronts, strict=True))
    size = max(1, MOST_PAIRS // max(1, len(second)))
    waiting: list[Front] = []
    for start in range(0, max(1, len(first)), size):
        budget.spend()
        some = slice(start, start + size)
        forms, pairs = sums(first[some], second, excess[some], width)
        pairs[:, 0] += start
        waiting.append(possible(Front(forms, excess[pairs[:, 0], pairs[:, 1]], pairs)))
        if sum(map(len, waiting)) > MOST_WAITING:
            waiting = [thinned(joined(waiting))]
    whole = joined(waiting)
    return thinned(whole) if len(whole) else whole


def merged(
    branch: Branch,
    fronts: tuple[Front, Front],
    wanted: Range,
    changes: tuple[Change, Change],
    budget: Budget,
) -> Front:
    """States of a set from those of its two children; all that cannot be completed are dropped."""
    a, b = fronts
    excess = a.excess[:, None] + b.excess - branch.closing
    first, second = branch.maps

    def possible(front: Front) -> Front:
        front = front.only(_completable(branch, front, wanted))
        return changes[0](front.only(_consistent(front)))

    return combine((first, second), fronts, excess, branch.width, (possible, changes[1]), budget)


def _completable(branch: Branch, front: Front, wanted: Range) -> BoolArray:
    """Whether the rest could make up for a state if each of its vectors gave its most."""
    rest = wanted.most[:, None, None] * np.diag(1 - branch.weights)
    return room(front.forms, rest[None], enough=ZERO_PIVOT) > ZERO_PIVOT


def _consistent(front: Front) -> BoolArray:
    """Whether a threshold's form has as many positive eigenvalues as its excess.

    It cannot have more; with fewer, some vectors that were left out are too much to leave.
    """
    if front.forms.shape[-1] == 0:
        return np.ones(len(front), dtype=np.bool_)
    values = np.linalg.eigvalsh(front.forms[:, 0])
    return np.asarray((values > -ZERO_PIVOT).sum(axis=1) >= front.excess)


def supported(front: Front, outside: Front, width: int, budget: Budget) -> BoolArray:
    """Which states some state of the rest completes."""
    found = np.zeros(len(front), dtype=np.bool_)
    for states in front.by_excess():
        partners = outside.forms[outside.excess == width - front.excess[states[0]]]
        size = max(1, MOST_PAIRS // max(1, len(partners)))
        for start in range(0, len(states), size):
            budget.spend()
            some = states[start : start + size]
            found[some] = room(front.forms[some], partners, enough=ZERO_PIVOT) > ZERO_PIVOT
    return found


def maxima(front: Front, most: int) -> Front:
    """The states that no other of the same excess exceeds; all where there are more than so many.

    States without a boundary are all alike, so that one is enough.
    """
    compared = most if front.forms.shape[-1] else len(front)
    kept = [
        states[maximal(front.forms[states])] if len(states) <= compared else states
        for states in front.by_excess()
    ]
    return front.only(np.concatenate(kept)) if kept else front
