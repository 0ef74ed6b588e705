"""Robust regression: its definition, symmetries, and coverage where there are outliers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid.errors import DataError, OptionError
from loopid.identification import (
    Bisquare,
    Huber,
    WeightedLeastSquares,
    quiet_fit,
    working_fit,
)
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

ESTIMATORS = [Huber(), Bisquare()]
each = pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda one: one.name)


def make_run(seed=0, count=300, share=0.05, size=12.0):
    """Normal errors, outliers in a share of the samples, a tenth of which is not used."""
    W, rng = smooth_regressor(samples=count), np.random.default_rng(seed)
    errors = rng.normal(size=(count, 2)) * DEVIATIONS + outliers(rng, (count, 2), share, size)
    return named_samples(W, W @ TRUTH + errors, rng.random((count, 2)) < 0.9)


@each
@given(u=st.floats(-8, 8))
def test_slopes_are_the_derivatives_of_scores(estimator, u):
    step = 1e-6
    ends = np.array([u - step, u + step])
    low, high = ends * estimator.weight(ends)
    if abs(abs(u) - estimator.tuning) > 1e-3:
        slope = estimator.slope(np.array([u]))[0]
        assert (high - low) / (2 * step) == pytest.approx(slope, abs=1e-5)


@each
def test_without_a_limit_it_is_weighted_least_squares(estimator):
    samples = make_run()
    found, plain = quiet_fit(samples, type(estimator)(1e6)), quiet_fit(samples, "wls")
    np.testing.assert_allclose(found.values, plain.values, rtol=1e-8)
    np.testing.assert_allclose(found.covariance, plain.covariance, rtol=1e-6)
    np.testing.assert_allclose(found.weights, plain.weights, rtol=1e-8)
    assert found.degrees_of_freedom == pytest.approx(plain.degrees_of_freedom)
    assert (found.robustness.down_weighted == 0).all()


@each
def test_estimates_solve_the_defining_equations(estimator):
    samples = make_run()
    found = quiet_fit(samples, estimator)
    scale, weights = found.robustness.scale, found.weights
    residual = samples.force - samples.regressor @ found.values
    u = np.where(samples.used, residual / scale, 0.0)
    counting = samples.used & (estimator.weight(u) > 0)
    slopes = (estimator.slope(u) * counting).sum(axis=0) / counting.sum(axis=0)
    errors = scale * u * estimator.weight(u) / slopes
    sums = np.einsum("ti,tij->j", weights**2 * errors, samples.regressor)
    size = np.sqrt(np.einsum("i,tij->j", weights**2, samples.regressor**2))
    np.testing.assert_allclose(sums / size, 0.0, atol=1e-6)
    low = (estimator.weight(u) < 0.5) & samples.used
    np.testing.assert_allclose(found.robustness.down_weighted, low.sum(0) / samples.used.sum(0))


def test_scales_are_those_of_the_median():
    samples = make_run()
    found = quiet_fit(samples, "huber")
    residual = np.abs(samples.force - samples.regressor @ found.values)
    for i in range(2):
        middle = np.median(residual[samples.used[:, i], i])
        assert found.robustness.scale[i] == pytest.approx(middle / 0.67449, rel=1e-4)


def test_huber_minimises_its_function():
    # At scales and weights held, whatever the direction.
    samples = make_run()
    found = working_fit(samples, "huber").result
    scale = found.robustness.scale
    shift = np.random.default_rng(0).normal(size=(20, 6)) * found.standard_errors
    residual = samples.force - samples.regressor @ found.values
    slopes = (np.abs(residual / scale) <= 1.345)[:, :] & samples.used
    parts = found.weights**2 * scale**2 / (slopes.sum(axis=0) / samples.used.sum(axis=0))

    def cost(values):
        u = np.abs(samples.force - samples.regressor @ values) / scale
        rho = np.where(u < 1.345, u**2 / 2, 1.345 * (u - 1.345 / 2))
        return (rho * samples.used * parts).sum()

    least = cost(found.values)
    assert all(cost(found.values + step) > least for step in 0.1 * shift)


@each
@pytest.mark.parametrize("size", [1e3, 1e6])
def test_outliers_of_any_size_do_not_break_it_but_least_squares(estimator, size):
    clean, spoilt = make_run(share=0.0), make_run(share=0.1, size=size)
    reach = 6 * quiet_fit(clean, estimator).standard_errors
    assert (np.abs(quiet_fit(spoilt, estimator).values - TRUTH) < reach).all()
    assert (np.abs(quiet_fit(spoilt, "wls").values - TRUTH) > reach).any()


def test_bisquare_forgets_outliers_that_huber_still_feels():
    W, rng = smooth_regressor(samples=300), np.random.default_rng(0)
    errors, far = rng.normal(size=(300, 2)), np.zeros((300, 2))
    far[::10] = 50.0
    clean, spoilt = (named_samples(W, W @ TRUTH + errors + part) for part in (0.0, far))
    moved = {
        name: np.abs(quiet_fit(spoilt, name).values - quiet_fit(clean, name).values).max()
        for name in ("huber", "bisquare")
    }
    assert moved["bisquare"] < 0.5 * moved["huber"]


@pytest.mark.parametrize("kind", [Huber, Bisquare])
@pytest.mark.parametrize("tuning", [0.0, -1.0, np.nan, np.inf])
def test_tuning_constants_that_are_none_are_refused(kind, tuning):
    with pytest.raises(OptionError, match="tuning"):
        kind(tuning)


def test_samples_without_errors_are_refused():
    samples = make_run()
    exact = samples.with_force(samples.predicted(TRUTH))
    with pytest.raises(DataError, match="without error"):
        quiet_fit(exact, "huber")
    few = outliers(np.random.default_rng(0), (300, 2), 0.02, 1e3)
    with pytest.raises(DataError, match="more than half"):
        quiet_fit(exact.with_force(exact.force + few), "bisquare")


@runs(8, 50)
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
@each
def test_normal_errors_cost_five_percent_of_the_efficiency(estimator, runs):
    W, errors = smooth_regressor(samples=150), {"robust": [], "plain": []}
    for seed in range(runs):
        force = W @ TRUTH + np.random.default_rng(seed).normal(size=(150, 2)) * DEVIATIONS
        samples = named_samples(W, force)
        errors["robust"].append(estimator.fit_samples(samples).result.values - TRUTH)
        errors["plain"].append(WeightedLeastSquares().fit(samples.problem).values - TRUTH)
    flat = (W / DEVIATIONS[:, None]).reshape(-1, 6)
    # Whitened by the bound all directions count alike: six squares a run, of the same errors.
    root = np.linalg.cholesky(flat.T @ flat)
    squares = {name: ((np.array(one) @ root) ** 2).mean() for name, one in errors.items()}
    assert squares["robust"] / squares["plain"] == pytest.approx(1 / 0.95, abs=0.6 / np.sqrt(runs))
