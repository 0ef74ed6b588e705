"""The highest smallest eigenvalue of a block, between what was reached and what was ruled out.

Ruling out is the cheaper the higher the threshold. So where a threshold just above the best
selection takes too much effort, thresholds come down by bisection, and then the effort grows.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import count
from math import sqrt

from loopid.arrays import IntArray
from loopid.base_parameters.search.engines import Engine
from loopid.base_parameters.search.strategy import TIE_TOLERANCE
from loopid.base_parameters.search.threshold import Budget, OutOfBudgetError

FINENESS = 1e-2  # relative distance of thresholds that are worth a test of their own
FIRST_STEP, LONGER = 2e-9, 30.0  # of relative steps up from a selection, and how they grow
NEAR = 1.05  # ends this close call for a threshold just above the lower one


@dataclass
class Bracket:
    """A block's best selection under a ceiling.

    Attributes
    ----------
    engine : Engine
    selection : IntArray
        (k,), the best seen.
    high : float
        No selection has a higher smallest eigenvalue, up to ties.
    below : float or None
        The ceiling.
    low : float
        The smallest eigenvalue of the selection.
    """

    engine: Engine
    selection: IntArray
    high: float
    below: float | None = None
    low: float = field(init=False)

    def __post_init__(self) -> None:
        self._select(self.selection)

    @property
    def closed(self) -> bool:
        """Whether the selection is proven best, up to ties."""
        return self.high <= self.low * (1 + TIE_TOLERANCE)

    def raise_to(self, enough: float, budget: Budget) -> None:
        """Find better selections until one is good enough, or the last one proven best.

        Raises
        ------
        OutOfBudgetError
            The bracket keeps what was found and proven until then.
        """
        for effort in count():
            if self._bisected(enough, effort, budget):
                return

    def lower(self, below: float, above: float, budget: Budget) -> bool:
        """Lower the ceiling; whether there is a selection under it and above a level.

        Raises
        ------
        OutOfBudgetError
        """
        self.below = below
        levels = self.engine.block.levels(self.selection)
        if levels.largest < below and levels.smallest > above:
            return True
        for effort in count():
            try:
                found = self.engine.first(above, below, effort, budget)
            except OutOfBudgetError:
                budget.check()
                continue
            if found is not None:
                self._select(found)
            return found is not None
        return False

    def _select(self, selection: IntArray) -> None:
        self.selection, self.low = selection, self.engine.block.levels(selection).smallest

    def _bisected(self, enough: float, effort: int, budget: Budget) -> bool:
        """Move both ends with a given effort; whether that settles it."""
        undecided: float | None = None
        while self.low < enough and not self.closed:
            if undecided is None:
                # Far below the upper end a threshold takes much effort, and proves little.
                near = effort == 0 or self.high <= self.low * NEAR
                threshold = self.low * (1 + TIE_TOLERANCE) if near else sqrt(self.low * self.high)
            elif self.high > undecided * (1 + FINENESS):
                threshold = sqrt(undecided * self.high)
            else:
                return False
            if not self._decided(threshold, effort, budget):
                undecided = threshold
            elif self.low >= threshold:
                undecided = None
        return True

    def _decided(self, threshold: float, effort: int, budget: Budget) -> bool:
        """Whether a selection above a threshold was found, or ruled out."""
        try:
            found = self.engine.first(threshold, self.below, effort, budget)
        except OutOfBudgetError:
            budget.check()
            return False
        if found is None:
            self.high = threshold
        else:
            self._climb(found, budget)
        return True

    def _climb(self, found: IntArray, budget: Budget) -> None:
        """Take a selection, and better ones while guesses hit, by steps that grow."""
        guess: IntArray | None = found
        step = FIRST_STEP
        while guess is not None:
            self._select(self._polished(guess))
            guess = self.engine.guess(self.low * (1 + step), self.below, budget)
            step *= LONGER

    def _polished(self, selection: IntArray) -> IntArray:
        """The selection after swaps that raise its smallest eigenvalue, if it stays below."""
        block, walked = self.engine.block, self.engine.polished(selection)
        before, after = block.levels(selection), block.levels(walked)
        fits = self.below is None or after.largest < self.below
        return walked if fits and after.smallest > before.smallest else selection
