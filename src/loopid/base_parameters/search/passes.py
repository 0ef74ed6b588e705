"""Passes over a branch decomposition: fronts of all sets upwards, of all that is outside downwards.

A front may grow too large. *Relaxed*, its states are bounded by a few forms that exceed them: what
no relaxed pass completes does not exist. *Restricted*, a few of its states stand for all: what a
restricted pass completes is a selection [Bergman2016].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from loopid.arrays import IntArray
from loopid.base_parameters.search.branches import Branch
from loopid.base_parameters.search.fronts import (
    Change,
    Front,
    Range,
    combine,
    joined,
    maxima,
    merged,
    single,
    supported,
)
from loopid.base_parameters.search.loewner import groups, maximal, room, upper_bounds
from loopid.base_parameters.search.threshold import Budget

Fronts = dict[Branch, Front]
# States of one excess, times the limit, among which those that others exceed are looked for.
COMPARED = 16


def upwards(
    branches: Sequence[Branch],
    wanted: Range,
    outside: Fronts,
    thin: Callable[[Branch, Front], Front],
    budget: Budget,
) -> Fronts | None:
    """Fronts of all sets, children first; None where a set has no state that can be completed.

    Parameters
    ----------
    branches : sequence of Branch
        All sets, children first.
    wanted : Range
    outside : dict of Front
        Bounds of what is outside a set, where known.
    thin : callable
        Makes a front smaller.
    budget : Budget
    """
    fronts: Fronts = {}
    for branch in branches:
        if branch.children:
            first, second = (fronts[child] for child in branch.children)
            possible = _supported_by(outside.get(branch), branch.width, budget)
            changes = possible, partial(thin, branch)
            front = merged(branch, (first, second), wanted, changes, budget)
        else:
            front = single(branch, wanted)
        if len(front) == 0:
            return None
        fronts[branch] = front
    return fronts


def _supported_by(rest: Front | None, width: int, budget: Budget) -> Change:
    """What leaves away the states that no state of the rest completes."""
    if rest is None:
        return lambda front: front
    return lambda front: front.only(supported(front, rest, width, budget))


def downwards(branches: Sequence[Branch], fronts: Fronts, limit: int, budget: Budget) -> Fronts:
    """Bounds of what is outside each set, from the root to the vectors."""
    root = branches[-1]
    kinds = fronts[root].forms.shape[1]
    nothing = Front(np.zeros((1, kinds, 0, 0)), np.zeros(1, np.int64), np.zeros((1, 2), np.int64))
    outside: Fronts = {root: nothing}
    for branch in reversed(branches):
        for own, other in ((0, 1), (1, 0)) if branch.children else ():
            child = branch.children[own]
            if child.children:
                pair = (outside[branch], fronts[branch.children[other]])
                possible = _supported_by(fronts[child], child.width, budget)
                changes = possible, partial(relaxed, limit=limit)
                outside[child] = _outside(branch, own, pair, changes, budget)
    return outside


def _outside(
    branch: Branch,
    own: int,
    fronts: tuple[Front, Front],
    changes: tuple[Change, Change],
    budget: Budget,
) -> Front:
    """States of the rest of a child: the rest of its parent with the other child."""
    child, sibling = branch.maps[own], branch.maps[1 - own]
    width, size = child.shape
    # Coordinates of the child first, then directions in which it has no part.
    turn, _ = np.linalg.qr(child.T, mode="complete")
    turn[:, :width] = child.T
    rest, beside = fronts
    maps = (np.eye(branch.width, size) @ turn, sibling @ turn)
    # A set and its rest have excesses that add up to the width of their boundary.
    excess = width - (branch.width - rest.excess[:, None] - beside.excess + branch.closing)
    return combine(maps, (rest, beside), excess, width, changes, budget)


def relaxed(front: Front, limit: int) -> Front:
    """At most ``limit`` states of each excess, which exceed all of the front."""
    front, parts = maxima(front, COMPARED * limit), []
    for states in front.by_excess():
        part = front.only(states)
        if len(part) > limit:
            bounds = upper_bounds(part.forms, groups(part.forms, limit))
            forms = bounds[maximal(bounds)]
            unknown = np.full((len(forms), 2), -1)
            part = Front(forms, part.excess[: len(forms)], unknown)
        parts.append(part)
    return joined(parts)


def restricted(front: Front, outside: Front, limit: int, width: int) -> Front:
    """At most ``limit`` states of each excess: of each group the one that the rest suits best.

    Without a boundary states are selections, some of which are taken as they come.
    """
    if width == 0:
        return front.only(np.linspace(0, len(front) - 1, min(limit, len(front))).astype(np.int64))
    front, kept = maxima(front, COMPARED * limit), []
    for states in front.by_excess():
        if len(states) > limit:
            forms = front.forms[states]
            partners = outside.forms[outside.excess == width - front.excess[states[0]]]
            spare = room(forms, partners)
            labels = groups(forms, limit)
            members = (np.flatnonzero(labels == label) for label in np.unique(labels))
            states = states[[own[spare[own].argmax()] for own in members]]
        kept.append(states)
    return front.only(np.concatenate(kept))


def selection(branches: Sequence[Branch], fronts: Fronts, state: int) -> IntArray:
    """The vectors selected by a state of the root, whose fronts must be exact, ascending."""
    chosen, open_ = [], [(branches[-1], state)]
    while open_:
        branch, state = open_.pop()
        if branch.children:
            origins = fronts[branch].origins[state]
            open_.extend(zip(branch.children, origins.tolist(), strict=True))
        elif state:
            chosen.append(branch.rows[0])
    return np.sort(np.array(chosen, dtype=np.int64))
