"""The posterior: conditioning of a joint normal distribution, its limits, its coverage."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import multivariate_normal

from loopid.errors import DataError, OptionError, RankError
from loopid.identification import (
    BayesianRidge,
    FitSamples,
    Prior,
    WeightedLeastSquares,
    evidence_scale,
    quiet_fit,
)
from smooth_data import (
    DEVIATIONS,
    TRUTH,
    assert_coverage,
    autoregressive,
    covered,
    named,
    named_samples,
    runs,
    smooth_regressor,
)

NAMES = named(6)
MEAN = TRUTH


def prior_of(seed=0, scale=1.0):
    """Correlated parameters."""
    root = np.random.default_rng(seed).normal(size=(6, 6))
    return Prior(NAMES, MEAN, scale**2 * (root @ root.T / 6 + 0.1 * np.eye(6)))


def make_run(seed=0, count=100, truth=MEAN, correlation=0.0):
    W = smooth_regressor(samples=count)
    errors = autoregressive(np.random.default_rng(seed), (count, 2), correlation) * DEVIATIONS
    return named_samples(W, W @ truth + errors)


def conditioned(samples, prior, noise):
    """Mean and covariance of φ given the forces, from their joint normal distribution."""
    W, S = samples.regressor.reshape(-1, 6), prior.covariance
    omega = np.diag(np.broadcast_to(noise**2, samples.force.shape).ravel())
    gain = S @ W.T @ np.linalg.inv(W @ S @ W.T + omega)
    left = samples.force.ravel() - W @ prior.values
    return prior.values + gain @ left, S - gain @ W @ S


@given(st.integers(0, 1000), st.integers(1, 30))
def test_the_posterior_is_the_conditional_distribution(seed, count):
    samples, prior = make_run(seed, count), prior_of(seed)
    found = BayesianRidge(prior, DEVIATIONS).fit(samples.problem)
    mean, covariance = conditioned(samples, prior, DEVIATIONS)
    np.testing.assert_allclose(found.values, mean, rtol=1e-7, atol=1e-9)
    # Conjugate: the covariance times what residuals and prior say of the noise's size.
    left = samples.force.ravel() - samples.regressor.reshape(-1, 6) @ prior.values
    W = samples.regressor.reshape(-1, 6)
    omega = np.diag(np.broadcast_to(DEVIATIONS**2, samples.force.shape).ravel())
    surprise = left @ np.linalg.solve(W @ prior.covariance @ W.T + omega, left)
    variance = (100 + surprise) / (100 + len(left))
    np.testing.assert_allclose(found.covariance, variance * covariance, rtol=1e-5, atol=1e-10)
    assert (found.degrees_of_freedom == 100 + len(left)).all()


def test_noise_of_the_data_is_that_of_weighted_least_squares():
    samples = make_run(count=400)
    found = quiet_fit(samples, BayesianRidge(prior_of()))
    mean, covariance = conditioned(samples, prior_of(), 1 / found.weights)
    np.testing.assert_allclose(found.values, mean, rtol=1e-8)
    np.testing.assert_allclose(1 / found.weights, DEVIATIONS, rtol=0.15)
    np.testing.assert_allclose(found.covariance, covariance, rtol=0.05, atol=0.05 * 1e-3)


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_a_vague_prior_leaves_least_squares(correlation):
    samples = make_run(correlation=correlation)
    vague = BayesianRidge(Prior.independent(NAMES, np.zeros(6), np.full(6, 1e6)))
    unknown = BayesianRidge(Prior.independent(NAMES, np.zeros(6), np.full(6, np.inf)))
    plain = quiet_fit(samples)
    for estimator in (vague, unknown):
        found = quiet_fit(samples, estimator)
        if not correlation:  # otherwise actuators count by what their samples are worth
            np.testing.assert_allclose(found.values, plain.values, rtol=1e-6)
            np.testing.assert_allclose(found.covariance, plain.covariance, rtol=1e-4)
            assert found.degrees_of_freedom == pytest.approx(plain.degrees_of_freedom)
        assert (np.abs(found.values - plain.values) < plain.standard_errors).all()


def test_no_data_leave_the_prior():
    samples, prior = make_run(), prior_of()
    data = samples.parameters, samples.actuators, samples.regressor, samples.force
    nothing = FitSamples.of(*data, used=np.zeros((100, 2), dtype=bool))
    found = quiet_fit(nothing, BayesianRidge(prior, DEVIATIONS))
    np.testing.assert_allclose(found.values, MEAN, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, prior.covariance, rtol=1e-8)
    assert np.isfinite(found.intervals()).all()
    with pytest.raises(DataError, match="no samples to estimate the noise"):
        quiet_fit(nothing, BayesianRidge(prior))


def test_data_in_parts_give_the_posterior_of_all():
    # Yesterday's posterior is today's prior, where the noise is known.
    known = {"noise": DEVIATIONS, "noise_samples": 1e12}
    first, second = make_run(1), make_run(2)
    half = BayesianRidge(prior_of(), **known).fit(first.problem)
    then = Prior(NAMES, half.values, half.covariance)
    one = BayesianRidge(then, **known).fit(second.problem)
    whole = BayesianRidge(prior_of(), **known).fit(FitSamples.combined([first, second]).problem)
    np.testing.assert_allclose(one.values, whole.values, rtol=1e-7)
    np.testing.assert_allclose(one.covariance, whole.covariance, rtol=1e-6, atol=1e-12)


@runs(20, 80)
@pytest.mark.parametrize(("correlation", "count"), [(0.0, 12), (0.9, 200)])
def test_intervals_cover_truths_of_the_prior(correlation, count, runs):
    prior, rates, errors = prior_of(scale=0.3), [], {"wls": [], "bayes": []}
    root = np.linalg.cholesky(prior.covariance)
    for seed in range(runs):
        truth = MEAN + root @ np.random.default_rng(1000 + seed).normal(size=6)
        samples = make_run(seed, count, truth, correlation)
        found = quiet_fit(samples, BayesianRidge(prior, DEVIATIONS, 1e4))
        rates.append(covered(found, truth))
        errors["bayes"].append(found.values - truth)
        errors["wls"].append(WeightedLeastSquares().fit(samples.problem).values - truth)
        assert (found.standard_errors < 1.1 * prior.deviations).all()
    assert_coverage(rates)
    assert np.mean(np.square(errors["bayes"])) < 0.8 * np.mean(np.square(errors["wls"]))


@pytest.mark.parametrize("scale", [0.2, 3.0])
def test_the_scale_of_the_prior_is_the_most_likely_one(scale):
    """Against the dense covariance of the data; of one parameter nothing is known."""
    prior = prior_of(seed=3)
    free = prior.covariance.copy()
    free[0], free[:, 0] = 0.0, 0.0
    free[0, 0] = np.inf
    rng = np.random.default_rng(4)
    truth = MEAN + scale * np.linalg.cholesky(prior.covariance) @ rng.normal(size=6)
    samples = make_run(seed=5, count=60, truth=truth)
    noise = quiet_fit(samples).noise
    noise = replace(noise, effective_samples=noise.samples.astype(float))
    found = evidence_scale(Prior(NAMES, MEAN, free), samples.problem, noise, bounds=(0.01, 100.0))
    weights = 1 / noise.deviation
    X = (samples.regressor * weights[:, None]).reshape(-1, 6)
    y = (samples.force * weights).ravel() - X @ MEAN

    def likelihood(factor):
        C = factor**2 * free
        C[0, 0] = 1e4
        return multivariate_normal.logpdf(y, np.zeros(len(y)), np.eye(len(y)) + X @ C @ X.T)

    best = likelihood(found)
    assert all(likelihood(found * other) <= best + 1e-6 for other in (0.5, 0.95, 1.05, 2.0))
    assert scale / 3 < found < 3 * scale
    assert evidence_scale(Prior(NAMES, MEAN, free), samples.problem, noise, bounds=(10, 20)) == (
        pytest.approx(10, rel=1e-2)
    )


def test_some_of_the_parameters_take_their_part_of_the_prior():
    samples, prior = make_run(), prior_of()
    part = prior.of(samples.parameters.select([4, 1]))
    np.testing.assert_array_equal(part.values, MEAN[[4, 1]])
    np.testing.assert_array_equal(part.covariance, prior.covariance[np.ix_([4, 1], [4, 1])])


def test_what_neither_data_nor_prior_tell_is_refused():
    samples = make_run()
    data = samples.parameters, samples.actuators, samples.regressor * [1, 1, 0, 1, 1, 1]
    blind = FitSamples.of(*data, samples.force)
    spread = np.array([1, 1, np.inf, 1, 1, 1])
    with pytest.raises(RankError, match=r"link2\.m"):
        quiet_fit(blind, BayesianRidge(Prior.independent(NAMES, MEAN, spread)))
    known = quiet_fit(blind, BayesianRidge(Prior.independent(NAMES, MEAN, np.ones(6))))
    assert known.values[2] == pytest.approx(MEAN[2])
    assert known.standard_errors[2] == pytest.approx(1.0, rel=0.05)


def test_what_is_no_prior_is_refused():
    with pytest.raises(OptionError, match=r"bayes needs a prior: pass BayesianRidge\(prior\)"):
        quiet_fit(make_run(), "bayes")
    with pytest.raises(DataError, match="above 0"):
        Prior.independent(NAMES, MEAN, np.array([1, 1, 0, 1, 1, 1]))
    with pytest.raises(DataError, match="shapes"):
        Prior.independent(NAMES, MEAN, np.ones(5))
    with pytest.raises(DataError, match="not positive definite"):
        Prior(NAMES, MEAN, np.ones((6, 6)))
    with pytest.raises(DataError, match="symmetric"):
        Prior(NAMES, MEAN, np.eye(6) + 0.1 * np.eye(6, k=1))
    with pytest.raises(DataError, match="shapes"):
        Prior(NAMES, MEAN[:5], np.eye(6))
    known = Prior.independent(NAMES.select(range(5)), MEAN[:5], np.ones(5))
    with pytest.raises(OptionError, match=r"parameter of the prior 'link5\.m'"):
        quiet_fit(make_run(), BayesianRidge(known))


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"noise": np.array([1.0, 0.0])}, "above 0"),
        ({"noise": np.ones(2), "noise_samples": 0.0}, "noise_samples"),
    ],
)
def test_noise_that_is_none_is_refused(options, word):
    with pytest.raises(OptionError, match=word):
        BayesianRidge(prior_of(), **options)


def test_noise_of_other_actuators_is_refused():
    with pytest.raises(DataError, match=r"shape \(2,\)"):
        BayesianRidge(prior_of(), np.ones(3)).fit(make_run().problem)
