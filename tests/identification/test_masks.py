"""Samples that do not take part: as if they were not there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid.errors import DataError, RankError
from loopid.identification import (
    FitProblem,
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)

DEVIATIONS = np.array([0.5, 3.0])
ESTIMATORS = (OrdinaryLeastSquares(), WeightedLeastSquares())


@pytest.fixture
def masked(make_samples):
    return lambda seed: random_samples(make_samples, seed)


def random_samples(make_samples, seed):
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(80, 2, 4))
    force = W @ [3.0, -1.0, 0.5, 10.0] + rng.normal(size=(80, 2)) * DEVIATIONS
    used = rng.random((80, 2)) < [0.9, 0.4]
    # What is not used may be anything.
    return make_samples(W, np.where(used, force, 1e6), used)


def dense_weighted(samples):
    """The textbook: rows of used samples, one variance an actuator, its share of the freedom."""
    W, tau, used = samples.regressor, samples.force, samples.used
    which = np.broadcast_to(np.arange(2), used.shape)[used]
    rows, rhs, variances = W[used], tau[used], np.ones(2)
    for _ in range(300):
        scale = 1 / np.sqrt(variances[which])
        A, b = rows * scale[:, None], rhs * scale
        values = np.linalg.lstsq(A, b)[0]
        hat = A @ np.linalg.solve(A.T @ A, A.T)
        residual = rhs - rows @ values
        freedom = [(1 - np.diag(hat))[which == i].sum() for i in range(2)]
        variances = np.array([(residual[which == i] ** 2).sum() / freedom[i] for i in range(2)])
    return values, np.linalg.inv(A.T @ A), 1 / np.sqrt(variances)


@given(st.integers(0, 10_000))
def test_weighted_estimates_equal_the_dense_computation(make_samples, seed):
    samples = random_samples(make_samples, seed)
    found = WeightedLeastSquares().fit(samples.problem)
    values, covariance, weights = dense_weighted(samples)
    np.testing.assert_allclose(found.values, values, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.weights, weights, rtol=1e-6)
    assert found.degrees_of_freedom == samples.used.sum() - 4


def test_ordinary_estimates_equal_the_dense_computation(masked):
    samples = masked(1)
    found = OrdinaryLeastSquares().fit(samples.problem)
    rows, rhs = samples.regressor[samples.used], samples.force[samples.used]
    values, squares, *_ = np.linalg.lstsq(rows, rhs)
    covariance = squares[0] / (len(rhs) - 4) * np.linalg.inv(rows.T @ rows)
    np.testing.assert_allclose(found.values, values, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: e.name)
def test_quality_is_that_of_the_samples_that_take_part(masked, estimator):
    samples = masked(2)
    quality = estimator.fit(samples.problem).quality
    values = estimator.fit(samples.problem).values
    for i in range(2):
        kept = samples.used[:, i]
        residual, force = samples.residual(values)[kept, i], samples.force[kept, i]
        assert quality.samples[i] == kept.sum()
        assert quality.residual_rms[i] == pytest.approx(np.sqrt((residual**2).mean()))
        expected = 1 - (residual**2).sum() / ((force - force.mean()) ** 2).sum()
        assert quality.r_squared[i] == pytest.approx(expected)


def test_parts_with_masks_combine(masked):
    samples = masked(3)
    W, tau, used = samples.regressor, samples.force, samples.used
    parts = [
        FitProblem.from_samples(
            W[k : k + 30], tau[k : k + 30], samples.parameters, samples.actuators, used[k : k + 30]
        )
        for k in range(0, 80, 30)
    ]
    whole, joined = samples.problem, FitProblem.combined(parts)
    np.testing.assert_array_equal(joined.samples, whole.samples)
    np.testing.assert_allclose(joined.mean_force, whole.mean_force)
    found, expected = (WeightedLeastSquares().fit(p) for p in (joined, whole))
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-8)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: e.name)
def test_an_actuator_without_samples_changes_nothing(masked, make_samples, estimator):
    samples = masked(4)
    used = samples.used & [True, False]
    found = estimator.fit(make_samples(samples.regressor, samples.force, used).problem)
    alone = make_samples(samples.regressor[:, :1], samples.force[:, :1], used[:, :1])
    expected = estimator.fit(alone.problem)
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-8, atol=1e-15)
    assert found.weights[1] == 0
    assert found.quality.samples[1] == 0
    assert np.isnan([found.quality.residual_rms[1], found.quality.r_squared[1]]).all()


def test_a_constant_force_has_no_share_to_explain(make_samples):
    rng, W = np.random.default_rng(0), np.ones((50, 2, 1))
    force = np.stack([np.full(50, 1 / 3), 1 + rng.normal(size=50)], axis=1)
    quality = OrdinaryLeastSquares().fit(make_samples(W, force).problem).quality
    assert np.isnan(quality.r_squared[0])
    assert quality.residual_rms[0] > 0
    assert quality.r_squared[1] < 1


def test_a_parameter_of_an_absent_actuator_is_named(masked, make_samples):
    samples = masked(5)
    W = samples.regressor.copy()
    W[:, 0, 2] = 0.0
    with pytest.raises(RankError, match=r"link2\.m at all"):
        OrdinaryLeastSquares().fit(
            make_samples(W, samples.force, samples.used & [1, 0] > 0).problem
        )


def test_an_actuator_that_its_own_parameters_explain_has_no_weight(make_samples):
    rng = np.random.default_rng(0)
    W = rng.normal(size=(20, 2, 2)) * np.array([[1, 0], [0, 1]])
    used = np.ones((20, 2), dtype=bool)
    used[1:, 1] = False
    with pytest.raises(DataError, match="actuator b is fitted without error"):
        WeightedLeastSquares().fit(make_samples(W, rng.normal(size=(20, 2)), used).problem)


def test_the_shares_of_the_freedom_keep_variances_unbiased(make_samples):
    # One actuator of 12 samples takes most of 6 parameters: an equal share would be far off.
    rng, found = np.random.default_rng(0), []
    W = rng.normal(size=(60, 2, 6))
    W[:, 1, 2:] = 0.0
    used = np.ones((60, 2), dtype=bool)
    used[12:, 0] = False
    for _ in range(400):
        force = rng.normal(size=(60, 2)) * DEVIATIONS
        fit = WeightedLeastSquares().fit(make_samples(W, force, used).problem)
        found.append(1 / fit.weights**2)
    np.testing.assert_allclose(np.mean(found, axis=0), DEVIATIONS**2, rtol=0.06)


@pytest.mark.parametrize(
    "used", [np.ones((79, 2), dtype=bool), np.ones((80, 2)), np.ones(80, dtype=bool)]
)
def test_wrong_masks_are_refused(masked, make_samples, used):
    samples = masked(6)
    with pytest.raises(DataError, match="used must be booleans"):
        make_samples(samples.regressor, samples.force, used)
    with pytest.raises(DataError, match="used must be booleans"):
        FitProblem.from_samples(
            samples.regressor, samples.force, samples.parameters, samples.actuators, used
        )
