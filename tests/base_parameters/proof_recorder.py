"""The proof of an exact search, written down while it runs: boxes that are empty, and why.

For each leaf of a box's tree the rows taken and the rows left out there. Every selection agrees
with exactly one leaf, or has no place for its rows.
"""

from dataclasses import dataclass
from unittest.mock import patch

import numpy as np

from loopid.base_parameters import ExactSearch, SearchOptions, exact
from loopid.base_parameters.branch_and_bound import Tree, one_between


@dataclass(frozen=True)
class Exclusion:
    """A box of eigenvalues that no selection of k rows of vectors (m, k) lies in."""

    vectors: np.ndarray
    above: float  # no selection has all eigenvalues of X_S X_Sᵀ in this open range
    below: float
    leaves: tuple


def proven(problem, **options):
    """What exact search finds, and the proof of it."""
    proof, trees = [], []

    class Recorded(RecordedTree):
        def __init__(self, *args):
            super().__init__(*args)
            trees.append(self)

    def asked(block, box, *effort, **settled):
        found = one_between(block, box, *effort, **settled)
        if found is None and not settled:
            proof.append(Exclusion(block.vectors, *box, tuple(trees[-1].leaves)))
        return found

    with (
        patch("loopid.base_parameters.branch_and_bound.Tree", Recorded),
        patch.object(exact, "one_between", asked),
    ):
        return ExactSearch(SearchOptions(**options)).search(problem), proof


class RecordedTree(Tree):
    """A tree that notes its leaves without a selection."""

    def __init__(self, *args):
        super().__init__(*args)
        self.leaves, self.pairs = [], None

    def close(self, taken, left):
        self.leaves.append((tuple(map(int, taken)), tuple(map(int, left))))

    def root(self):
        found = super().root()
        if found is None:
            self.close((), ())
        return found

    def settled(self, node, taken, left):
        found = super().settled(node, taken, left)
        if found is None:
            more, fewer = node.free[taken], node.free[left]
            self.close([*node.taken, *more], [*node.left, *fewer])
        return found

    def listed(self, node):
        found = list(super().listed(node))
        inside = {tuple(own) for own in found}
        for outside in map(tuple, self.agreeing(node)):
            if outside not in inside:
                self.close(outside, np.setdiff1d(np.arange(self.block.size), outside))
        yield from found

    def conflicts(self, node):
        self.pairs = super().conflicts(node)
        return self.pairs

    def options(self, node, places):
        self.pairs = None
        takeable, leavable = super().options(node, places)
        none = np.zeros_like(node.leave, dtype=bool)
        apart, together = self.pairs or (none, none)
        sides = node.taken.tolist(), node.left.tolist()
        ruled_out = (~takeable, apart), (~leavable, together)
        for place in np.flatnonzero(~(takeable & leavable)):
            row = int(node.free[place])
            for side, (impossible, pairs) in enumerate(ruled_out):
                if impossible[place]:
                    self.close_option(row, node.free[pairs[place]].tolist(), sides, side)
            if not (takeable[place] or leavable[place]):
                break
            sides[0 if takeable[place] else 1].append(row)
        return takeable, leavable

    def close_option(self, row, neighbours, sides, side):
        """Leaves of a row on a side: with each of its neighbours, and with none of them."""
        own, other = [*sides[side], row], list(sides[1 - side])
        for neighbour in neighbours:
            if neighbour in own:
                break
            if neighbour not in other:
                both = [*own, neighbour]
                self.close(*((both, other) if side == 0 else (other, both)))
                other.append(neighbour)
        self.close(*((own, other) if side == 0 else (other, own)))
