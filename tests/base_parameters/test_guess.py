"""Swaps beneath a barrier: predictions for each of them hold, and no walk ends worse."""

from dataclasses import dataclass

import numpy as np
import pytest
from choice_problems import all_selections, block_of
from hypothesis import given
from hypothesis import strategies as st

from loopid.base_parameters.search import guess
from loopid.base_parameters.search.guess import (
    ABOVE,
    BELOW,
    SIDES,
    Barrier,
    good_selection,
    walked,
)
from loopid.base_parameters.search.qr import pivots
from loopid.base_parameters.search.tree import Block, Budget

ENDLESS = Budget(np.inf)


@st.composite
def blocks(draw, most=14, decades=0.0):
    """Vectors in general position; with ``decades``, ill-conditioned together."""
    n = draw(st.integers(3, most))
    k = draw(st.integers(1, n - 1))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    X = rng.normal(size=(n, k)) * 10 ** np.linspace(0, -decades, k)
    X = X @ np.linalg.qr(rng.normal(size=(k, k)))[0]
    return block_of(X / np.linalg.norm(X, 2))


@dataclass(frozen=True)
class Case:
    """A selection, and a barrier on one side of its eigenvalues."""

    block: Block
    chosen: np.ndarray
    level: float
    barrier: Barrier

    @property
    def rest(self):
        return np.setdiff1d(np.arange(self.block.size), self.chosen)

    def inverses(self, chosen):
        """Eigenvalues of (side (M - b I))⁻¹ for any selection."""
        values = np.linalg.svd(self.block.vectors[chosen], compute_uv=False) ** 2
        return self.barrier.side / (values - self.level)

    def swaps(self):
        for place in range(len(self.chosen)):
            for other, into in enumerate(self.rest):
                chosen = self.chosen.copy()
                chosen[place] = into
                yield place, other, chosen


@st.composite
def cases(draw):
    block = draw(blocks())
    chosen = np.array(draw(st.permutations(range(block.size)))[: block.count])
    levels, fraction = block.levels(chosen), draw(st.sampled_from([0.3, 0.5, 0.9]))
    side = draw(st.sampled_from([BELOW, ABOVE]))
    level = levels.smallest * fraction if side == BELOW else levels.largest / fraction
    return Case(block, chosen, level, Barrier.at(level, block.vectors, chosen, side))


@given(cases())
def test_the_potential_after_every_swap_is_that_of_the_selection_it_makes(case):
    now = case.inverses(case.chosen)
    assert case.barrier.potential == pytest.approx(now.sum())
    changes = case.barrier.changes(case.chosen, case.rest)
    for place, other, chosen in case.swaps():
        fresh = case.inverses(chosen)
        # Round-off is enlarged as far as the inverse changes.
        scale = now.sum() * max(1.0, np.abs(fresh).max() / now.min())
        if np.isfinite(changes[place, other]):
            assert changes[place, other] == pytest.approx(
                fresh.sum() - now.sum(), rel=1e-7, abs=1e-9 * scale
            )


@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("decades", [0.0, 5.0])
@given(data=st.data(), fraction=st.sampled_from([0.3, 0.9, 0.99]))
def test_a_walk_never_ends_worse_than_it_began(sides, decades, data, fraction):
    block = data.draw(blocks(decades=decades))
    start = pivots(block.vectors, block.count)
    end = walked(block, start, ENDLESS, fraction, sides)
    before, after = block.levels(start), block.levels(end)
    if ABOVE in sides:
        assert after.ratio <= before.ratio * (1 + 1e-6)
    else:
        assert after.smallest >= before.smallest * (1 - 1e-6)


@given(blocks())
def test_where_a_walk_ends_no_swap_raises_the_smallest_eigenvalue_much(block):
    end = walked(block, pivots(block.vectors, block.count), ENDLESS, 0.999)
    rest = np.setdiff1d(np.arange(block.size), end)
    best = block.levels(end).smallest
    for place in range(block.count):
        for into in rest:
            chosen = end.copy()
            chosen[place] = into
            assert block.levels(chosen).smallest < best * 1.05


@pytest.mark.parametrize("decades", [0.0, 5.0])
@given(data=st.data(), floor=st.sampled_from([0.0, 0.9]))
def test_a_good_selection_is_regular_never_worse_than_the_pivots_and_always_the_same(
    decades, data, floor
):
    block = data.draw(blocks(decades=decades))
    chosen = good_selection(block, ENDLESS, floor)
    start = block.levels(pivots(block.vectors, block.count))
    levels = block.levels(chosen)
    assert len(set(chosen.tolist())) == block.count
    assert (np.diff(chosen) > 0).all()
    assert levels.smallest > 0
    worst = max(start.largest, floor) / start.smallest
    assert max(levels.largest, floor) / levels.smallest <= worst * (1 + 1e-6)
    np.testing.assert_array_equal(chosen, good_selection(block, ENDLESS, floor))


def test_nothing_to_choose_needs_no_swap():
    X = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
    np.testing.assert_array_equal(good_selection(block_of(X), ENDLESS), np.arange(4))


def test_after_the_deadline_the_first_guess_stands():
    block = block_of(np.linalg.qr(np.random.default_rng(0).normal(size=(400, 150)))[0])
    chosen = good_selection(block, Budget(-np.inf))
    np.testing.assert_array_equal(chosen, np.sort(pivots(block.vectors, block.count)))


def test_good_selections_are_close_to_the_best_and_kicks_bring_them_closer(monkeypatch):
    found = {36: [], 0: []}
    for seed in range(20):
        block = block_of(np.linalg.qr(np.random.default_rng(seed).normal(size=(11, 5)))[0])
        least = min(block.levels(chosen).ratio for chosen in all_selections(block))
        for large, ratios in found.items():
            monkeypatch.setattr(guess, "LARGE", large)
            monkeypatch.setattr(guess, "LOOKED_AT", 0)
            ratios.append(block.levels(good_selection(block, ENDLESS)).ratio / least)
    assert np.median(found[36]) < 1.1
    assert np.median(found[0]) < 1.02
    assert np.mean(found[0]) <= np.mean(found[36])
