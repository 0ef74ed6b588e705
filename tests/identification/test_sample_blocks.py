"""What a fit finds does not depend on how many samples are in memory at a time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from loopid.identification.autoregression import (
    LARGEST_ORDER,
    PAIRS_PER_COEFFICIENT,
    WHITE_FLOOR,
    burg_covariances,
    run_lengths,
)
from loopid.identification.correlation import lagged_grams
from loopid.identification import eliminate
from loopid.identification.selection import mean_squared_error
from scipy.signal import lfilter

from block_sizes import set_block_rows
from loopid.identification import FitSamples, fit_in_steps
from loopid.identification import quiet_fit

__all__ = ["set_block_rows"]

TRUTH = np.array([3.0, -1.0, 0.5, 10.0, 2.0, -4.0])
SIZES = [1, 7, 64]


@pytest.fixture
def make_log(make_regressor, make_errors, make_samples):
    """Samples with slow errors, masks and gaps."""

    def make(seed, samples=400):
        rng, W = np.random.default_rng(seed), make_regressor(seed, samples)
        used = rng.random((samples, 2)) < 0.9
        used[50:80, 1] = False
        force = W @ TRUTH + make_errors(rng, (samples, 2), 0.9) * [0.5, 4.0]
        return make_samples(W, force, used, np.arange(samples) * 4 // samples)

    return make


def assert_same(one, other):
    for name in ("values", "covariance", "weights", "degrees_of_freedom", "condition_number"):
        mine, theirs = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(mine, theirs, rtol=1e-7, atol=1e-9 * np.abs(mine).max())
    for name in ("residual_rms", "r_squared", "samples"):
        mine, theirs = getattr(one.quality, name), getattr(other.quality, name)
        np.testing.assert_allclose(mine, theirs, rtol=1e-9)
    np.testing.assert_array_equal(one.noise.orders, other.noise.orders)
    for name in ("coefficients", "innovation", "deviation", "lag_one", "effective_samples"):
        mine, theirs = getattr(one.noise, name), getattr(other.noise, name)
        np.testing.assert_allclose(mine, theirs, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("estimator", ["ols", "wls"])
def test_fits(make_log, set_block_rows, size, estimator):
    whole = quiet_fit(make_log(0), estimator)
    assert (whole.noise.orders > 0).all()
    set_block_rows(size)
    assert_same(quiet_fit(make_log(0), estimator), whole)


@pytest.mark.filterwarnings("ignore::loopid.errors.CorrelationWarning")
@pytest.mark.filterwarnings("ignore::loopid.errors.ExcitationWarning")
def test_two_steps_several_logs_and_reductions(make_log, set_block_rows):
    def found():
        logs = make_log(0), make_log(1)
        both = FitSamples.combined(logs)
        labels = both.parameters.labels
        reduction = eliminate(both, make_log(2))
        return (
            quiet_fit(both),
            fit_in_steps(*logs, [labels[0], labels[4]]),
            reduction.result,
            reduction,
        )

    *whole, reduced = found()
    set_block_rows(33)
    *blocked, reduced_there = found()
    for one, other in zip(whole, blocked, strict=True):
        assert_same(one, other)
    for one, other in zip(reduced.steps, reduced_there.steps, strict=True):
        assert one.labels == other.labels
        for name in ("validation_error", "standard_error", "excess", "excess_error"):
            assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("size", SIZES)
def test_samples(make_log, set_block_rows, size):
    samples = make_log(0)
    W, force = samples.regressor, samples.force
    expected = force - W @ TRUTH
    set_block_rows(size)
    np.testing.assert_allclose(samples.residual(TRUTH), expected, atol=1e-12)
    np.testing.assert_allclose(samples.predicted(TRUTH), W @ TRUTH, atol=1e-12)
    np.testing.assert_array_equal(samples.less(W[:, :, 0]).force, force - W[:, :, 0])
    some = samples.select([4, 1])
    np.testing.assert_array_equal(some.regressor, W[:, :, [4, 1]])
    assert some.parameters.labels == tuple(samples.parameters.labels[j] for j in (4, 1))
    assert samples.pieces == tuple(slice(k, k + 100) for k in range(0, 400, 100))
    joined = FitSamples.combined([samples, some.select([0, 1]), samples][::2])
    np.testing.assert_array_equal(joined.regressor, np.concatenate([W, W]))
    np.testing.assert_array_equal(joined.stretches, np.repeat(np.arange(8), 100))


def positive(factors):
    """Triangular factors whose rows have positive diagonals: QR leaves the signs free."""
    signs = np.sign(np.diagonal(factors, axis1=-2, axis2=-1))
    return factors * np.where(signs == 0, 1.0, signs)[..., None]


def test_merging_factors_is_stacking_samples(make_log):
    a, b, c = (make_log(seed).problem for seed in (0, 1, 2))
    whole = FitSamples.combined([make_log(seed) for seed in (0, 1, 2)]).problem
    for merged in (a.merge(b).merge(c), a.merge(b.merge(c)), c.merge(a).merge(b)):
        np.testing.assert_allclose(positive(merged.factors), positive(whole.factors), atol=1e-10)
        np.testing.assert_array_equal(merged.samples, whole.samples)
        np.testing.assert_allclose(merged.mean_force, whole.mean_force, rtol=1e-12)
        np.testing.assert_allclose(
            merged.residual_squares(TRUTH), whole.residual_squares(TRUTH), rtol=1e-10
        )


def burg_step_by_step(errors, runs):
    """Burg's recursion on the prediction errors themselves, all orders up to the largest."""
    forward = np.where(runs > 0, errors, 0.0)
    backward = forward.copy()
    observed = forward @ forward / (runs > 0).sum()
    white = WHITE_FLOOR * observed
    polynomial, variance = np.ones(1), observed + white
    covariances = [variance]
    for k in range(1, LARGEST_ORDER + 1):
        rows = np.flatnonzero(runs > k)
        if len(rows) < PAIRS_PER_COEFFICIENT * k:
            break
        ahead, behind, past = forward[rows], backward[rows - 1], polynomial[1:]
        common = ahead @ behind + len(rows) * white * (past @ past[::-1])
        energy = ahead @ ahead + behind @ behind + 2 * len(rows) * white * (polynomial @ polynomial)
        reflection = -2 * common / energy
        covariances.append(-reflection * variance - past @ covariances[:0:-1])
        forward[rows], backward[rows] = ahead + reflection * behind, behind + reflection * ahead
        longer = np.append(polynomial, 0.0)
        polynomial, variance = longer + reflection * longer[::-1], variance * (1 - reflection**2)
    return np.array(covariances) / (1 + WHITE_FLOOR)


@pytest.mark.parametrize("size", [*SIZES, 10_000])
@pytest.mark.parametrize("poles", [[], [0.98], [1.8, -0.97]])
def test_burgs_sums_are_those_of_prediction_errors(set_block_rows, size, poles):
    rng, pieces = np.random.default_rng(0), (slice(0, 500), slice(500, 1600))
    errors = lfilter([1.0], np.append(1.0, np.negative(poles)), rng.normal(size=1600))
    used = rng.random(1600) < 0.97
    set_block_rows(size)
    runs = run_lengths(used, pieces)
    found = burg_covariances(errors, runs)
    expected = burg_step_by_step(errors, runs)[: len(found)]
    assert len(found) > len(poles)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10 * expected[0])


@given(st.lists(st.booleans(), min_size=3, max_size=40), st.integers(1, 9))
def test_runs_end_at_gaps_and_pieces(used, size):
    used, cut = np.array(used), len(used) // 2
    pieces = slice(0, cut), slice(cut, len(used))
    expected = []
    for t, present in enumerate(used):
        before = expected[t - 1] if t not in (0, cut) else 0
        expected.append(before + 1 if present else 0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("loopid.scratch.BLOCK_ROWS", size)
        np.testing.assert_array_equal(run_lengths(used, pieces), expected)


@pytest.mark.parametrize("size", [*SIZES, 1000])
def test_lagged_sums_stay_within_pieces(set_block_rows, size):
    X = np.random.default_rng(0).normal(size=(60, 3))
    pieces = slice(0, 4), slice(4, 5), slice(5, 60)
    expected = np.zeros((7, 3, 3))
    for piece in pieces:
        x = X[piece]
        for k in range(min(7, len(x))):
            expected[k] += x[: len(x) - k].T @ x[k:]
    set_block_rows(size)
    np.testing.assert_allclose(lagged_grams(X, pieces, 6), expected, atol=1e-12)


def test_validation_errors(make_log, set_block_rows):
    values, scale = 1.1 * TRUTH, np.array([2.0, 0.0])
    whole = mean_squared_error(make_log(0), values, scale)
    set_block_rows(13)
    assert mean_squared_error(make_log(0), values, scale) == pytest.approx(whole, rel=1e-9)
