"""Intervals and warnings where residuals are autocorrelated."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy
from scipy.linalg import block_diag, toeplitz

from bank_robots import few_of
from loopid.errors import DataWarning
from loopid.identification import FitSamples, OrdinaryLeastSquares, WeightedLeastSquares, fit
from loopid.identification.correlation import Autoregression
from loopid.identification.fitting import quiet_fit
from smooth_data import (
    DEVIATIONS,
    TRUTH,
    assert_coverage,
    autoregressive,
    covered,
    named_samples,
    runs,
    smooth_regressor,
)


def segments_of(samples, parts=3):
    return np.arange(samples) * parts // samples


def omega_of(result, samples, i):
    """The dense covariance matrix of one actuator's errors."""
    noise = result.noise
    model = Autoregression.of_coefficients(noise.coefficients[i], noise.innovation[i] ** 2)
    longest = max(np.bincount(samples.segments))
    lags = np.append(model.covariances, np.zeros(longest))
    for t in range(model.order + 1, longest):
        lags[t] = model.coefficients @ lags[t - 1 : t - model.order - 1 : -1]
    counts = np.bincount(samples.segments)
    return block_diag(*(toeplitz(lags[:count]) for count in counts))


@pytest.mark.parametrize("estimator", ["ols", "wls"])
def test_the_covariance_is_the_dense_sandwich(estimator):
    W, rng = smooth_regressor(samples=300), np.random.default_rng(0)
    used = rng.random((300, 2)) < 0.8
    force = W @ TRUTH + autoregressive(rng, (300, 2), 0.8) * DEVIATIONS
    samples = named_samples(W, force, used, segments_of(300))
    result = quiet_fit(samples, estimator)
    bread = meat = 0.0
    for i, weight in enumerate(result.weights):
        X = weight * W[:, i] * used[:, i, None]
        bread = bread + X.T @ X
        meat = meat + weight**2 * X.T @ omega_of(result, samples, i) @ X
    inverse = np.linalg.inv(bread)
    np.testing.assert_allclose(result.covariance, inverse @ meat @ inverse, rtol=1e-6)


def test_white_errors_give_the_covariance_of_independent_ones():
    W, rng = smooth_regressor(samples=200), np.random.default_rng(0)
    samples = named_samples(W, W @ TRUTH + rng.normal(size=(200, 2)) * DEVIATIONS)
    result, plain = quiet_fit(samples), WeightedLeastSquares().fit(samples.problem)
    assert result.noise.coefficients.shape == (2, 0)
    np.testing.assert_allclose(result.covariance, plain.covariance, rtol=1e-9)
    assert (result.degrees_of_freedom == plain.degrees_of_freedom).all()
    np.testing.assert_array_equal(result.noise.effective_samples, result.noise.samples)
    np.testing.assert_allclose(result.noise.deviation, 1 / plain.weights, rtol=1e-9)


def test_errors_of_alternating_sign_count_no_more_than_their_number():
    W, errors = smooth_regressor(), autoregressive(np.random.default_rng(0), (1000, 2), -0.9)
    noise = quiet_fit(named_samples(W, errors)).noise
    assert (noise.lag_one < -0.8).all()
    np.testing.assert_array_equal(noise.effective_samples, noise.samples)


def test_the_model_of_the_errors_is_found():
    W, rng = smooth_regressor(samples=4000), np.random.default_rng(3)
    force = W @ TRUTH + autoregressive(rng, (4000, 2), 0.9) * DEVIATIONS
    noise = quiet_fit(named_samples(W, force)).noise
    np.testing.assert_allclose(noise.deviation, DEVIATIONS, rtol=0.15)
    np.testing.assert_allclose(noise.innovation, DEVIATIONS * np.sqrt(1 - 0.81), rtol=0.05)
    np.testing.assert_allclose(noise.lag_one, 0.9, atol=0.02)
    np.testing.assert_allclose(noise.effective_samples, 4000 * 0.1 / 1.9, rtol=0.25)


def test_samples_that_inform_would_give_the_covariance_if_they_were_independent():
    """Of one parameter a motor: a mean, and the size of a wave that is faster than the errors."""
    W = np.zeros((1000, 2, 2))
    W[:, 0, 0], W[:, 1, 1] = 1.0, np.sin(np.arange(1000))
    errors = autoregressive(np.random.default_rng(0), (1000, 2), 0.98)
    result = quiet_fit(named_samples(W, errors))
    noise, squares = result.noise, (W**2).sum(axis=(0, 1))
    expected = 1000 * noise.deviation**2 / (squares * np.diag(result.covariance))
    assert expected[0] == pytest.approx(noise.effective_samples[0])
    assert expected[1] > 1000 > 50 * noise.effective_samples[1]
    np.testing.assert_allclose(noise.informing_samples, np.minimum(expected, 1000))


def test_parameters_near_zero_are_named_once():
    W, rng = smooth_regressor(samples=200), np.random.default_rng(0)
    truth = TRUTH * [1, 1, 0, 1, 0, 1]
    with pytest.warns(DataWarning, match=r"2 of 6 .* link2\.m, link4\.m") as caught:
        result = fit(named_samples(W, W @ truth + 0.1 * rng.normal(size=(200, 2))))
    assert len(caught) == 1
    assert result.insignificant() == ("link2.m", "link4.m")


def test_good_data_warn_of_nothing():
    W, rng = smooth_regressor(samples=200), np.random.default_rng(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit(named_samples(W, W @ TRUTH + 0.01 * rng.normal(size=(200, 2))))


@pytest.mark.filterwarnings("ignore::loopid.errors.DataWarning")
def test_too_few_effective_samples_determine_no_interval():
    W, rng = smooth_regressor(samples=200, count=14, harmonics=8), np.random.default_rng(2)
    samples = named_samples(W, autoregressive(rng, (200, 2), 0.999, lead=20_000))
    result = quiet_fit(samples)
    assert (result.degrees_of_freedom < 1).all()
    assert np.isinf(result.intervals()).all()
    assert len(result.insignificant()) == 14


@pytest.mark.parametrize("make", [np.zeros_like, lambda force: force])
def test_data_without_errors_have_no_uncertainty(make):
    W = smooth_regressor(samples=200)
    result = quiet_fit(named_samples(W, make(W @ TRUTH)), "ols")
    assert np.isfinite(result.covariance).all()
    assert result.standard_errors.max() < 1e-9
    assert result.noise.coefficients.shape == (2, 0)


@pytest.mark.validate
@pytest.mark.parametrize("runs", [150])
def test_standard_errors_are_the_spread_of_estimates_whatever_the_gaps(runs):
    W, stated, values = smooth_regressor(samples=600), [], []
    used = np.random.default_rng(9).random((600, 2)) < 0.7
    for seed in range(runs):
        errors = autoregressive(np.random.default_rng(seed), (600, 2), 0.9) * DEVIATIONS
        result = quiet_fit(named_samples(W, errors, used, segments_of(600)))
        stated.append(result.standard_errors)
        values.append(result.values)
    ratio = np.median(stated, axis=0) / np.std(values, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=3 / np.sqrt(runs))
    assert ratio.mean() == pytest.approx(1.0, abs=1.5 / np.sqrt(runs))


@runs(25, 200)
def test_ordinary_intervals_allow_for_actuators_that_differ(runs):
    W, plain, rates = smooth_regressor(samples=200), [], []
    for seed in range(runs):
        errors = np.random.default_rng(seed).normal(size=(200, 2)) * DEVIATIONS
        samples = named_samples(W, W @ TRUTH + errors)
        plain.append(covered(OrdinaryLeastSquares().fit(samples.problem)))
        rates.append(covered(quiet_fit(samples, "ols")))
    assert np.mean(plain, axis=0).min() < 0.9
    assert_coverage(rates)


@pytest.mark.parametrize("ratio", few_of([1e2, 1e6], 1e6))
def test_actuators_may_differ_vastly(ratio):
    # The residual of the quiet one is all what the noisy one has bent; the model ends up odd, and
    # must still give intervals.
    W, rates = smooth_regressor(samples=300), []
    for seed in range(20):
        errors = autoregressive(np.random.default_rng(seed), (300, 2), 0.8) * [1.0, ratio]
        result = quiet_fit(named_samples(W, W @ TRUTH + errors), "ols")
        assert np.isfinite(result.covariance).all()
        rates.append(covered(result))
    assert np.mean(rates) > 0.9


@runs(30, 500)
def test_intervals_cover_with_white_uniform_errors(runs):
    W, rates, truth = smooth_regressor(samples=150, dof=4, count=15, harmonics=8), [], np.arange(15)
    for seed in range(runs):
        errors = np.random.default_rng(seed).uniform(-12, 12, size=(150, 4))
        rates.append(covered(quiet_fit(named_samples(W, W @ truth + errors)), truth))
    assert_coverage(rates, slack=0.005)


@pytest.mark.validate
@pytest.mark.parametrize("runs", [120])
@pytest.mark.parametrize(
    ("kind", "plain_below"),
    few_of(
        [("0.5", 0.85), ("0.9", 0.5), ("0.98", 0.3), ("0.98 with gaps", 0.3), ("filtered", 0.85)],
        *[("0.98 with gaps", 0.3), ("filtered", 0.85)],
    ),
)
def test_intervals_cover_where_independence_fails(kind, plain_below, runs):
    W, rates, plain = smooth_regressor(samples=1000), [], []
    gaps = (np.arange(1000)[:, None] // 40 + np.arange(2)) % 4 > 0
    lowpass = scipy.signal.butter(2, 0.4, output="sos")
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        if kind == "filtered":
            errors = scipy.signal.sosfiltfilt(lowpass, rng.normal(size=(1000, 2)), axis=0)
        else:
            errors = autoregressive(rng, (1000, 2), float(kind.split()[0]))
        used = gaps if "gaps" in kind else None
        samples = named_samples(W, W @ TRUTH + errors * DEVIATIONS, used)
        rates.append(covered(quiet_fit(samples)))
        plain.append(covered(WeightedLeastSquares().fit(samples.problem)))
    assert np.mean(plain) < plain_below
    assert_coverage(rates, slack=0.02)


def several(rng, count, varied=0.0, length=120):
    """Recordings of different motions and sizes, with parameters that vary from one to the next."""
    parts = []
    for k in range(count):
        W = (0.7 + 0.1 * k) * smooth_regressor(k, length)
        mine = TRUTH * (1 + varied * rng.normal(size=6))
        errors = autoregressive(rng, (length, 2), 0.5) * DEVIATIONS
        parts.append(named_samples(W, W @ mine + errors))
    return FitSamples.combined(parts)


def test_variances_between_recordings_are_those_of_the_jackknife():
    samples = several(np.random.default_rng(0), 5, varied=0.2)
    within = quiet_fit(replace(samples, runs=np.zeros(len(samples), dtype=int)), "ols")
    X, y = samples.regressor.reshape(-1, 6), samples.force.ravel()
    runs = np.repeat(samples.runs, 2)
    off = [np.linalg.lstsq(X[runs != k], y[runs != k])[0] - within.values for k in range(5)]
    jackknife = 0.8 * np.square(off).sum(axis=0)
    found, least = quiet_fit(samples, "ols"), np.diag(within.covariance)
    assert (jackknife > least).any()
    np.testing.assert_allclose(np.diag(found.covariance), np.maximum(jackknife, least))
    np.testing.assert_array_equal(found.degrees_of_freedom == 4, jackknife > least)


def test_what_one_or_two_recordings_tell_has_no_scatter():
    two = several(np.random.default_rng(0), 2, varied=0.5)
    apart = replace(two, runs=np.zeros(len(two), dtype=int))
    np.testing.assert_array_equal(quiet_fit(two).covariance, quiet_fit(apart).covariance)
    W, rng = smooth_regressor(samples=300), np.random.default_rng(0)
    W[100:, :, 0] = 0.0
    samples = replace(
        named_samples(W, W @ TRUTH + rng.normal(size=(300, 2))), runs=np.arange(300) // 100
    )
    alone = quiet_fit(replace(samples, runs=np.zeros(300, dtype=int)))
    assert quiet_fit(samples).standard_errors[0] <= 3 * alone.standard_errors[0]


@pytest.mark.validate
@pytest.mark.parametrize("runs", [150])
@pytest.mark.parametrize(
    ("count", "varied"),
    few_of([(4, 0.0), (4, 0.02), (4, 0.1), (9, 0.0), (9, 0.1)], (4, 0.0), (4, 0.1)),
)
def test_intervals_cover_what_varies_between_recordings(count, varied, runs):
    rates, apart = [], []
    for seed in range(runs):
        samples = several(np.random.default_rng(seed), count, varied)
        rates.append(covered(quiet_fit(samples)))
        apart.append(covered(quiet_fit(replace(samples, runs=np.zeros(len(samples), dtype=int)))))
    slack = 2 * np.sqrt(0.95 * 0.05 / runs)
    assert 0.94 - slack < np.mean(rates) < 0.985 + slack
    assert np.mean(rates, axis=0).min() > 0.9 - 1.5 * slack
    assert varied < 0.1 or np.mean(apart) < 0.8
