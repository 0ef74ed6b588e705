"""Robust regression: its definition, symmetries, and coverage where there are outliers."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from loopid.errors import DataError, OptionError
from loopid.identification import Bisquare, WeightedLeastSquares
from loopid.identification.fitting import quiet_fit
from loopid.identification.robust import bisquare, huber
from smooth_data import (
    DEVIATIONS,
    TRUTH,
    assert_coverage,
    autoregressive,
    covered,
    named_samples,
    outliers,
    runs,
    smooth_regressor,
)

LIMIT = 4.685


def make_run(seed=0, count=300, share=0.05, size=12.0):
    """Normal errors, outliers in a share of the samples, a tenth of which is not used."""
    W, rng = smooth_regressor(samples=count), np.random.default_rng(seed)
    errors = rng.normal(size=(count, 2)) * DEVIATIONS + outliers(rng, (count, 2), share, size)
    return named_samples(W, W @ TRUTH + errors, rng.random((count, 2)) < 0.9)


@pytest.mark.parametrize("score", [huber, bisquare])
@given(u=st.floats(-8, 8))
def test_slopes_are_the_derivatives_of_scores(score, u):
    step, limit = 1e-6, 2.0
    ends = np.array([u - step, u + step])
    low, high = ends * score(ends, limit)[0]
    if abs(abs(u) - limit) > 1e-3:
        slope = score(np.array([u]), limit)[1][0]
        assert (high - low) / (2 * step) == pytest.approx(slope, abs=1e-5)


def test_without_a_limit_it_is_weighted_least_squares():
    samples = make_run()
    found, plain = quiet_fit(samples, Bisquare(1e6)), quiet_fit(samples, "wls")
    np.testing.assert_allclose(found.values, plain.values, rtol=1e-8)
    np.testing.assert_allclose(found.covariance, plain.covariance, rtol=1e-6)
    np.testing.assert_allclose(found.weights, plain.weights, rtol=1e-8)
    assert found.degrees_of_freedom == pytest.approx(plain.degrees_of_freedom)
    assert (found.robustness.down_weighted == 0).all()


def test_estimates_solve_the_defining_equations():
    samples = make_run()
    found = quiet_fit(samples, "bisquare")
    scale, weights = found.robustness.scale, found.weights
    residual = samples.force - samples.regressor @ found.values
    u = np.where(samples.used, residual / scale, 0.0)
    weighed, slope = bisquare(u, LIMIT)
    counting = samples.used & (weighed > 0)
    slopes = (slope * counting).sum(axis=0) / counting.sum(axis=0)
    errors = scale * u * weighed / slopes
    sums = np.einsum("ti,tij->j", weights**2 * errors, samples.regressor)
    size = np.sqrt(np.einsum("i,tij->j", weights**2, samples.regressor**2))
    np.testing.assert_allclose(sums / size, 0.0, atol=1e-6)
    low = (weighed < 0.5) & samples.used
    np.testing.assert_allclose(found.robustness.down_weighted, low.sum(0) / samples.used.sum(0))


@pytest.mark.parametrize("size", [1e3, 1e6])
def test_outliers_of_any_size_do_not_break_it_but_least_squares(size):
    clean, spoilt = make_run(share=0.0), make_run(share=0.1, size=size)
    reach = 6 * quiet_fit(clean, "bisquare").standard_errors
    assert (np.abs(quiet_fit(spoilt, "bisquare").values - TRUTH) < reach).all()
    assert (np.abs(quiet_fit(spoilt, "wls").values - TRUTH) > reach).any()


@pytest.mark.parametrize("tuning", [0.0, -1.0, np.nan, np.inf])
def test_tuning_constants_that_are_none_are_refused(tuning):
    with pytest.raises(OptionError, match="tuning"):
        Bisquare(tuning)


def test_samples_without_errors_are_refused():
    samples = make_run()
    exact = samples.with_force(samples.predicted(TRUTH))
    with pytest.raises(DataError, match="without error"):
        quiet_fit(exact, "bisquare")
    few = outliers(np.random.default_rng(0), (300, 2), 0.02, 1e3)
    with pytest.raises(DataError, match="more than half"):
        quiet_fit(exact.with_force(exact.force + few), "bisquare")


@pytest.mark.validate
@pytest.mark.parametrize("runs", [50])
@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_intervals_cover_where_there_are_outliers(correlation, runs):
    W, rates, errors = smooth_regressor(samples=600), [], {"bisquare": [], "wls": []}
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        noise = autoregressive(rng, (600, 2), correlation) * DEVIATIONS + outliers(rng, (600, 2))
        samples = named_samples(W, W @ TRUTH + noise)
        fits = {name: quiet_fit(samples, name) for name in errors}
        for name, found in fits.items():
            errors[name].append(found.values - TRUTH)
        rates.append(covered(fits["bisquare"]))
    assert_coverage(rates)
    spread = {name: np.sqrt(np.mean(np.square(errors[name]))) for name in errors}
    assert spread["bisquare"] < 0.7 * spread["wls"]


@runs(12, 60)
def test_normal_errors_cost_five_percent_of_the_efficiency(runs):
    W, errors = smooth_regressor(samples=150), {"robust": [], "plain": []}
    for seed in range(runs):
        force = W @ TRUTH + np.random.default_rng(seed).normal(size=(150, 2)) * DEVIATIONS
        samples = named_samples(W, force)
        errors["robust"].append(Bisquare().fit_samples(samples).result.values - TRUTH)
        errors["plain"].append(WeightedLeastSquares().fit(samples.problem).values - TRUTH)
    flat = (W / DEVIATIONS[:, None]).reshape(-1, 6)
    # Whitened by the bound all directions count alike: six squares a run, of the same errors.
    root = np.linalg.cholesky(flat.T @ flat)
    squares = {name: ((np.array(one) @ root) ** 2).mean() for name, one in errors.items()}
    assert squares["robust"] / squares["plain"] == pytest.approx(1 / 0.95, abs=0.6 / np.sqrt(runs))
