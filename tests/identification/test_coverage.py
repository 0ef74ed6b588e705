"""Do intervals cover at their rate? Counted over seeded repetitions."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from loopid.identification import OrdinaryLeastSquares, WeightedLeastSquares
from loopid.identification import quiet_fit

DEVIATIONS = np.array([0.5, 4.0])
TRUTH = np.array([3.0, -1.0, 0.5, 10.0, 2.0, -4.0])


def covered(result, truth=TRUTH):
    low, high = result.intervals().T
    return (low <= truth) & (truth <= high)


def test_standard_errors_are_the_spread_of_estimates_whatever_the_gaps(
    make_regressor, make_errors, make_samples
):
    W, stated, values = make_regressor(samples=600), [], []
    used = np.random.default_rng(9).random((600, 2)) < 0.7
    for seed in range(150):
        errors = make_errors(np.random.default_rng(seed), (600, 2), 0.9) * DEVIATIONS
        result = quiet_fit(make_samples(W, errors, used, np.arange(600) // 200))
        stated.append(result.standard_errors)
        values.append(result.values)
    ratio = np.median(stated, axis=0) / np.std(values, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.25)
    assert ratio.mean() == pytest.approx(1.0, abs=0.12)


def test_ordinary_intervals_allow_for_actuators_that_differ(make_regressor, make_samples):
    W, rates = make_regressor(samples=200), {"plain": [], "fit": []}
    for seed in range(200):
        errors = np.random.default_rng(seed).normal(size=(200, 2)) * DEVIATIONS
        samples = make_samples(W, W @ TRUTH + errors)
        rates["plain"].append(covered(OrdinaryLeastSquares().fit(samples.problem)))
        rates["fit"].append(covered(quiet_fit(samples, "ols")))
    plain, robust = (np.mean(rates[name], axis=0) for name in ("plain", "fit"))
    assert plain.min() < 0.9
    assert robust.min() > 0.9


@pytest.mark.parametrize("ratio", [1e2, 1e4, 1e6])
def test_actuators_may_differ_vastly(make_regressor, make_errors, make_samples, ratio):
    # The residual of the quiet one is all what the noisy one has bent; the model ends up odd, and
    # must still give intervals.
    W, rates = make_regressor(samples=300), []
    for seed in range(30):
        errors = make_errors(np.random.default_rng(seed), (300, 2), 0.8) * [1.0, ratio]
        result = quiet_fit(make_samples(W, W @ TRUTH + errors), "ols")
        assert np.isfinite(result.covariance).all()
        rates.append(covered(result))
    assert np.mean(rates) > 0.9


def test_intervals_cover_with_white_uniform_errors(make_regressor, make_samples):
    W, rates = make_regressor(samples=150, dof=4, count=15, harmonics=8), []
    truth = np.arange(15.0)
    for seed in range(500):
        errors = np.random.default_rng(seed).uniform(-12, 12, size=(150, 4))
        rates.append(covered(quiet_fit(make_samples(W, W @ truth + errors)), truth))
    each = np.mean(rates, axis=0)
    assert (each > 0.92).all()
    assert (each < 0.98).all()
    assert 0.94 < each.mean() < 0.96


@pytest.mark.parametrize(("coefficient", "plain_below"), [(0.5, 0.8), (0.9, 0.45), (0.98, 0.25)])
@pytest.mark.parametrize("gaps", [False, True])
def test_intervals_cover_where_independence_fails(
    make_regressor, make_errors, make_samples, coefficient, plain_below, gaps
):
    W, rates, plain = make_regressor(samples=1000), [], []
    used = (np.arange(1000)[:, None] // 40 + np.arange(2)) % 4 > 0 if gaps else None
    for seed in range(120):
        errors = make_errors(np.random.default_rng(seed), (1000, 2), coefficient) * DEVIATIONS
        samples = make_samples(W, W @ TRUTH + errors, used)
        rates.append(covered(quiet_fit(samples)))
        plain.append(covered(WeightedLeastSquares().fit(samples.problem)))
    assert np.mean(plain) < plain_below
    assert 0.9 < np.mean(rates) < 0.98


def test_intervals_cover_where_forces_were_filtered(make_regressor, make_samples):
    lowpass, W, rates, plain = butter(2, 0.4, output="sos"), make_regressor(samples=1000), [], []
    for seed in range(120):
        white = np.random.default_rng(seed).normal(size=(1000, 2)) * DEVIATIONS
        samples = make_samples(W, W @ TRUTH + sosfiltfilt(lowpass, white, axis=0))
        rates.append(covered(quiet_fit(samples)))
        plain.append(covered(WeightedLeastSquares().fit(samples.problem)))
    assert np.mean(plain) < 0.8
    assert 0.92 < np.mean(rates) < 0.98
