"""A rank that round-off may have made is refused, and the refusal says what was measured."""

import re

import numpy as np
import pytest
from choice_problems import parameters
from hypothesis import given, strategies as st

from loopid.base_parameters import (
    analyse,
    find_base_parameters,
)
from loopid.base_parameters.structure import decide_rank
from loopid.errors import (
    LoopidError,
    RankError,
)
from loopid.observation import Observation


def observe(W):
    return Observation.from_matrix(W, parameters(W.shape[1]))


def noisy(level, n=9, r=5):
    rng = np.random.default_rng(1)
    W = rng.normal(size=(60, r)) @ rng.normal(size=(r, n))
    return W + level * np.linalg.norm(W) / 60 * rng.normal(size=W.shape)


@pytest.mark.parametrize("level", [1e-10, 1e-9, 1e-8])
def test_noise_that_may_be_signal_is_refused(level):
    with pytest.raises(RankError, match=r"ambiguous: 2 gaps \(ranks 5, 9\)"):
        analyse(observe(noisy(level)))


@pytest.mark.parametrize(("level", "rank"), [(1e-15, 5), (1e-2, 9)])
def test_round_off_is_not_signal_and_large_noise_is(level, rank):
    assert analyse(observe(noisy(level))).rank == rank


@given(st.integers(25, 35), st.floats(1.0, 2.5))
def test_a_slow_decay_has_no_rank_and_the_largest_gap_is_named(place, jump):
    """Halved from value to value down to round-off, but for one larger jump."""
    values = 10 ** -np.r_[np.arange(place) * 0.3, np.arange(place, 60) * 0.3 + jump]
    with pytest.raises(RankError, match="no gap of at least 1000") as caught:
        decide_rank(values)
    gap, at = re.search(
        r"largest gap is ([\d.]+) after value (\d+) of 60", str(caught.value)
    ).groups()
    assert float(gap) == pytest.approx(10 ** (0.3 + jump), rel=0.01)
    assert int(at) == place


@given(st.integers(2, 8), st.integers(1, 8), st.integers(1, 8), st.floats(-11.0, -8.0))
def test_two_gaps_are_refused_with_both_ranks(first, second, rest, exponent):
    values = np.r_[np.ones(first), np.full(second, 10**exponent), np.full(rest, 1e-17)]
    expected = rf"2 gaps \(ranks {first}, {first + second}\)"
    with pytest.raises(RankError, match=expected):
        decide_rank(values)


@given(st.integers(1, 30), st.integers(0, 30), st.floats(-5.0, 0.0), st.floats(-18.0, -15.5))
def test_one_clear_gap_is_the_rank(r, d, lowest, noise):
    above, below = 10 ** np.linspace(0, lowest, r), 10 ** np.linspace(noise, noise - 2, d)
    rank, gap = decide_rank(np.r_[above, below])
    assert rank == r
    floor = np.finfo(float).eps
    assert gap == pytest.approx(above[-1] / max(below[0] if d else 0.0, floor))


def test_no_effect_at_all_is_refused():
    with pytest.raises(RankError, match="no parameter has an effect"):
        find_base_parameters(observe(np.zeros((8, 4))))


@given(st.integers(0, 5), st.floats(-11.9, -9.1))
def test_a_doubtful_column_is_refused_by_name(column, exponent):
    W = np.linalg.qr(np.random.default_rng(2).normal(size=(20, 6)))[0]
    W[:, column] *= 10**exponent
    label = parameters(6)[column].label
    with pytest.raises(RankError, match=f"column {re.escape(label)} is neither zero nor") as caught:
        analyse(observe(W))
    assert f"{10**exponent:.1e} of the largest" in str(caught.value)
    assert "--rounding" in str(caught.value)


def test_as_many_rows_as_the_rank_may_hide_a_larger_one():
    W = np.random.default_rng(3).normal(size=(4, 7))
    with pytest.raises(RankError, match="more samples are needed"):
        analyse(observe(W))
    assert analyse(observe(np.vstack([W, W]))).rank == 4


def test_a_rank_error_is_one_of_ours_and_arithmetic():
    assert issubclass(RankError, LoopidError)
    assert issubclass(RankError, ArithmeticError)
