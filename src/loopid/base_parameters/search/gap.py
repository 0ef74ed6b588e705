"""How much better a selection could be at most: bounds that hold at any time.

The tree at a threshold is the smaller the higher the threshold, and once it is exhausted the
threshold is a bound. So thresholds come down by bisection with few nodes each, then with more.
What is proven does not depend on the time; how far it gets does. Derivation in
docs/derivations.md.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import sqrt

import numpy as np

from loopid.base_parameters.search.block import Block
from loopid.base_parameters.search.strategy import TIE_TOLERANCE
from loopid.base_parameters.search.threshold import Budget, OutOfBudgetError, selections_between

FIRST_NODES, MORE_NODES = 16, 4  # nodes a threshold, and the factor when none of them was enough
FINENESS = 1e-3  # relative distance of thresholds that are worth a test of their own
# Ratio of the levels at the ends of the topmost slice, and of its logarithm from slice to slice.
TOP_SLICE, WIDER = 1.02, 1.5

# A value found above a threshold, or the threshold itself where none is above it.
Test = Callable[[float, Budget], float]


def highest_smallest_bound(
    block: Block, low: float, budget: Budget, below: float | None = None
) -> float:
    """A level that the smallest eigenvalue of no selection exceeds.

    Parameters
    ----------
    block : Block
    low : float
        Positive; lower levels are of no interest, for example because a selection reaches it.
    budget : Budget
        When it is used up, the bound proven so far is returned.
    below : float, optional
        Only selections are meant whose eigenvalues are all smaller than this.

    Returns
    -------
    float
        At least ``low``; up to round-off and the tie tolerance equal to the highest smallest
        eigenvalue, or to ``low`` where that is higher, if the budget lasts.
    """
    all_rows = np.linalg.svd(block.vectors, compute_uv=False)[-1] ** 2
    test = partial(_smallest_above, block, below)
    return _bound(test, low, float(all_rows) * (1 + TIE_TOLERANCE), budget)


def lowest_ratio_bound(block: Block, ratio: float, highest: float, budget: Budget) -> float:
    """A ratio of largest to smallest eigenvalue that no selection is below.

    Parameters
    ----------
    block : Block
    ratio : float
        Higher ratios are of no interest, for example because a selection has this one.
    highest : float
        What no smallest eigenvalue exceeds, as from ``highest_smallest_bound``.
    budget : Budget
        When it is used up, the bound proven so far is returned.

    Returns
    -------
    float
        At most ``ratio``; up to round-off and the tie tolerance equal to the lowest ratio, or to
        ``ratio`` where that is lower, if the budget lasts.
    """
    least_largest = block.least_largest() * (1 - TIE_TOLERANCE)
    test = partial(_inverse_ratio_above, block, highest, least_largest)
    return 1 / _bound(test, 1 / ratio, highest / least_largest, budget)


def _bound(test: Test, low: float, high: float, budget: Budget) -> float:
    """What no value exceeds, given that none exceeds ``high``; at least ``low``."""
    allowed = FIRST_NODES
    try:
        while high > low * (1 + 2 * TIE_TOLERANCE):
            low, high = _bisected(test, low, high, allowed, budget)
            allowed *= MORE_NODES
    except OutOfBudgetError:
        pass
    return max(low, high)


def _bisected(
    test: Test, low: float, high: float, nodes: int, budget: Budget
) -> tuple[float, float]:
    """The two closer together, by tests of at most so many nodes each."""
    unknown, threshold = low, low * (1 + TIE_TOLERANCE)
    while threshold < high:
        found = _tested(test, threshold, nodes, budget)
        if found is None:
            unknown = threshold
        elif found > threshold:
            low = unknown = found
        else:
            high = threshold
        if high <= unknown * (1 + FINENESS):
            break
        threshold = sqrt(unknown * high)
    return low, high


def _tested(test: Test, threshold: float, nodes: int, budget: Budget) -> float | None:
    """The outcome of a test; None when its nodes ran out."""
    spent = Budget(budget.deadline, most_nodes=min(nodes, budget.most_nodes - budget.nodes))
    found = None
    try:
        found = test(threshold, spent)
    except OutOfBudgetError:
        budget.check()
    budget.nodes += spent.nodes
    budget.leaves += spent.leaves
    return found


def _smallest_above(block: Block, below: float | None, threshold: float, budget: Budget) -> float:
    for selection in selections_between(block, threshold, below, budget):
        return block.levels(selection).smallest
    return threshold


def _inverse_ratio_above(
    block: Block, highest: float, least_largest: float, threshold: float, budget: Budget
) -> float:
    """Smallest eigenvalues in slices from the highest down, each with its own ceiling."""
    top, width = highest * (1 + TIE_TOLERANCE), TOP_SLICE
    while top > least_largest * threshold:
        bottom = top / width
        for selection in selections_between(block, bottom, top / threshold, budget):
            inverse = 1 / block.levels(selection).ratio
            if inverse > threshold:
                return inverse
        top, width = bottom * (1 + TIE_TOLERANCE), width**WIDER
    return threshold
