"""Least squares on factors: the textbook's estimates, weights of any data, intervals that cover."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from loopid.errors import DataError, RankError
from loopid.identification import FitSamples, OrdinaryLeastSquares, WeightedLeastSquares
from loopid.identification.fitting import quiet_fit
from loopid.identification.quality import fit_quality
from smooth_data import DEVIATIONS, assert_coverage, covered, named, named_samples, runs

TRUTH = np.array([3.0, -1.0, 0.5, 10.0])
ESTIMATORS = (OrdinaryLeastSquares(), WeightedLeastSquares())
each = pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: e.name)


def made(seed=0, count=80, share=(0.9, 0.4)):
    """Two actuators, some of whose samples are not used: they may be anything."""
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(count, 2, 4))
    force = W @ TRUTH + rng.normal(size=(count, 2)) * DEVIATIONS
    used = rng.random((count, 2)) < share
    return named_samples(W, np.where(used, force, 1e6), used)


def dense_weighted(samples):
    """The textbook: rows of used samples, one variance an actuator, its share of the freedom."""
    used = samples.used
    which = np.broadcast_to(np.arange(2), used.shape)[used]
    rows, rhs, variances = samples.regressor[used], samples.force[used], np.ones(2)
    for _ in range(100):
        scale = 1 / np.sqrt(variances[which])
        A, b = rows * scale[:, None], rhs * scale
        values = np.linalg.lstsq(A, b)[0]
        left = 1 - np.diag(A @ np.linalg.solve(A.T @ A, A.T))
        squares = (rhs - rows @ values) ** 2
        variances = np.array([squares[which == i].sum() / left[which == i].sum() for i in (0, 1)])
    return values, np.linalg.inv(A.T @ A), 1 / np.sqrt(variances)


@given(st.integers(0, 10_000))
def test_weighted_estimates_equal_the_dense_computation(seed):
    samples = made(seed)
    found = WeightedLeastSquares().fit(samples.problem)
    values, covariance, weights = dense_weighted(samples)
    np.testing.assert_allclose(found.values, values, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.weights, weights, rtol=1e-6)
    assert (found.degrees_of_freedom == samples.used.sum() - 4).all()


def test_exact_values_have_no_error_where_round_off_makes_variances_negative():
    found = WeightedLeastSquares().fit(made().problem)
    exact = replace(found, covariance=np.diag([-7e-52, 0.0, 4.0, 9.0]))
    assert exact.standard_errors.tolist() == [0.0, 0.0, 2.0, 3.0]


@given(st.integers(0, 10_000))
def test_ordinary_estimates_are_the_textbooks(seed):
    samples = made(seed)
    found = OrdinaryLeastSquares().fit(samples.problem)
    flat, rhs = samples.regressor[samples.used], samples.force[samples.used]
    expected, squares, *_ = np.linalg.lstsq(flat, rhs)
    np.testing.assert_allclose(found.values, expected, rtol=1e-9)
    covariance = squares[0] / (len(rhs) - 4) * np.linalg.inv(flat.T @ flat)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-8, atol=1e-12)
    assert found.condition_number == pytest.approx(np.linalg.cond(flat))


@each
def test_quality_is_that_of_the_samples_that_take_part(estimator):
    samples, other = made(2), made(3)
    found = estimator.fit(samples.problem)
    for data, quality in (
        (samples, found.quality),
        (other, fit_quality(other.problem, found.values)),
    ):
        residual = data.force - found.forces(data.regressor)
        for i in range(2):
            used = data.used[:, i]
            left, force = residual[used, i], data.force[used, i]
            assert quality.samples[i] == used.sum()
            assert quality.residual_rms[i] == pytest.approx(np.sqrt((left**2).mean()))
            expected = 1 - (left**2).sum() / ((force - force.mean()) ** 2).sum()
            assert quality.r_squared[i] == pytest.approx(expected)


def test_a_constant_force_has_no_share_to_explain():
    rng, W = np.random.default_rng(0), np.ones((50, 2, 1))
    force = np.stack([np.full(50, 1 / 3), 1 + rng.normal(size=50)], axis=1)
    quality = OrdinaryLeastSquares().fit(named_samples(W, force).problem).quality
    assert np.isnan(quality.r_squared[0])
    assert quality.residual_rms[0] > 0
    assert quality.r_squared[1] < 1


NOISES = (0.0, 1e-14, 1e-12, 1e-10, 3e-10, 1e-9, 1e-8, 1e-6)
SIZES = np.array([1.0, 10.0, 100.0, 1000.0])


def nearly_exact_weights():
    """Relative deviations by the weights of data with so little noise, ill-conditioned as logs are.

    Thirty columns in nearly parallel pairs, of sizes from 0.01 to 100.
    """
    rng = np.random.default_rng(0)
    W = rng.normal(size=(200, 4, 30))
    W[:, :, 1::2] = W[:, :, ::2] + 1e-6 * W[:, :, 1::2]
    W *= SIZES[:, None] * 10.0 ** rng.uniform(-2, 2, size=30)
    force = W @ (rng.normal(size=30) / np.abs(W).max(axis=(0, 1)))
    size, noise = np.sqrt((force**2).mean(axis=0)), rng.normal(size=force.shape)
    found = []
    for level in NOISES:
        problem = named_samples(W, force + level * size * noise).problem
        found.append(1 / WeightedLeastSquares().fit(problem).weights / size)
    return np.array(found)


def test_weights_converge_however_small_the_noise():
    found = nearly_exact_weights()
    for level, deviations in zip(NOISES, found, strict=True):
        # Errors below 1e-10 of the force count as round-off.
        np.testing.assert_allclose(deviations, max(level, 1e-10), rtol=0.1)


@pytest.mark.validate
def test_weights_of_little_noise_are_the_same_on_another_processor():
    program = "import json, test_least_squares as t; print(t.nearly_exact_weights().tolist())"
    paths = os.pathsep.join(path for path in sys.path if path)
    environment = {**os.environ, "OPENBLAS_CORETYPE": "Nehalem", "PYTHONPATH": paths}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    np.testing.assert_allclose(json.loads(done.stdout), nearly_exact_weights(), rtol=1e-4)


def test_an_actuator_that_its_own_parameters_explain_has_no_weight():
    rng = np.random.default_rng(0)
    W = rng.normal(size=(20, 2, 2)) * np.array([[1, 0], [0, 1]])
    used = np.ones((20, 2), dtype=bool)
    used[1:, 1] = False
    with pytest.raises(DataError, match=r"actuator b is fitted without error.*use ols"):
        WeightedLeastSquares().fit(named_samples(W, rng.normal(size=(20, 2)), used).problem)


def test_forces_of_zero_leave_no_weight():
    samples = made()
    with pytest.raises(DataError, match=r"actuator a is fitted without error.*use ols"):
        WeightedLeastSquares().fit(samples.with_force(0 * samples.force).problem)


def with_twin(W):
    """The last two columns alike: only the sum of their parameters is excited."""
    return np.concatenate([W[:, :, :3], W[:, :, 2:3]], axis=2)


@each
@pytest.mark.parametrize(
    ("spoil", "failure", "word"),
    [
        (with_twin, RankError, "do not excite a combination of link2.m, link3.m"),
        (lambda W: W * np.array([1, 1, 0, 1]), RankError, "do not excite link2.m at all"),
        (lambda W: W * np.array([[1, 1, 0, 1], [1, 1, 1, 1]]), RankError, "link2.m at all"),
        (lambda W: W[:2], DataError, "4 forces cannot determine 4"),
    ],
    ids=["twins", "no effect", "effect where not used", "few rows"],
)
def test_what_data_do_not_excite_is_refused(estimator, spoil, failure, word):
    W = spoil(np.random.default_rng(0).normal(size=(60, 2, 4)))
    used = np.ones(W.shape[:2], dtype=bool)
    used[4:, 1] = False
    used[:4, 1] = W[0, 0, 2] != 0
    with pytest.raises(failure, match=word):
        estimator.fit(named_samples(W, W @ TRUTH, used).problem)


@runs(60, 500)
def test_weighted_estimates_are_unbiased_sharp_and_covered(runs):
    W = np.random.default_rng(0).normal(size=(60, 3, 4))
    values, rates = {"ols": [], "wls": []}, []
    for seed in range(runs):
        errors = np.random.default_rng(100 + seed).normal(size=(60, 3)) * [0.5, 2.0, 8.0]
        problem = named_samples(W, W @ TRUTH + errors).problem
        fits = {estimator.name: estimator.fit(problem) for estimator in ESTIMATORS}
        rates.append(covered(fits["wls"], TRUTH))  # ordinary ones assume one variance for all
        for name, fit in fits.items():
            values[name].append(fit.values)
    assert_coverage(rates, slack=0.0)
    spread = {name: np.std(found, axis=0) for name, found in values.items()}
    for name, found in values.items():
        bias = np.abs(np.mean(found, axis=0) - TRUTH)
        assert (bias < 4 * spread[name] / np.sqrt(runs)).all()
    assert (spread["wls"] < 0.5 * spread["ols"]).all()


@pytest.mark.validate
@pytest.mark.parametrize("runs", [400])
def test_the_shares_of_the_freedom_keep_variances_unbiased(runs):
    # One actuator of 12 samples takes most of 6 parameters: an equal share would be far off.
    rng, found = np.random.default_rng(0), []
    W = rng.normal(size=(60, 2, 6))
    W[:, 1, 2:] = 0.0
    used = np.ones((60, 2), dtype=bool)
    used[12:, 0] = False
    for _ in range(runs):
        force = rng.normal(size=(60, 2)) * [0.5, 3.0]
        fit = WeightedLeastSquares().fit(named_samples(W, force, used).problem)
        found.append(1 / fit.weights**2)
    np.testing.assert_allclose(np.mean(found, axis=0), [0.25, 9.0], rtol=1.5 / np.sqrt(runs))


@runs(100, 500)
def test_ordinary_least_squares_reaches_the_bound_of_cramer_and_rao(runs):
    W, found = np.random.default_rng(0).normal(size=(200, 2, 4)), []
    for seed in range(runs):
        force = W @ TRUTH + 2 * np.random.default_rng(seed).normal(size=(200, 2))
        found.append(OrdinaryLeastSquares().fit(named_samples(W, force).problem).values - TRUTH)
    flat = W.reshape(-1, 4) / 2
    squares = (np.array(found) @ np.linalg.cholesky(flat.T @ flat)) ** 2
    assert squares.mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / squares.size))


LEAST = 0.01


def with_known_zeros(seed=0, least=LEAST):
    """One actuator with errors of 0.5, and one whose force is known to be zero."""
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(200, 2, 4))
    W[:, 1] -= np.outer(W[:, 1] @ TRUTH, TRUTH) / (TRUTH @ TRUTH)  # at right angles to the truth
    force = W @ TRUTH
    force[:, 0] += 0.5 * rng.normal(size=200)
    force[:, 1] = 0.0
    return FitSamples.of(named(4), ("motor", "free"), W, force, least_errors=[0.0, least])


def test_forces_known_to_be_zero_count_by_the_stated_error():
    data = with_known_zeros()
    found = quiet_fit(data)
    deviation = np.array([found.noise.deviation[0], LEAST])
    flat = (data.regressor / deviation[:, None]).reshape(-1, 4)
    expected = np.linalg.lstsq(flat, (data.force / deviation).ravel())[0]
    np.testing.assert_allclose(found.values, expected, rtol=1e-3)
    np.testing.assert_allclose(found.weights[1], 1 / LEAST)
    np.testing.assert_allclose(found.noise.deviation[1], LEAST, rtol=0.02)
    covariance = np.linalg.inv(flat.T @ flat)
    # The motor's errors may look a little correlated.
    np.testing.assert_allclose(found.covariance, covariance, atol=0.3 * covariance.max())
    vague = quiet_fit(with_known_zeros(least=2.0))
    assert (found.standard_errors < vague.standard_errors).all()


def test_larger_errors_than_the_stated_ones_count_as_they_are():
    data = with_known_zeros()
    force = data.force + [0, 0.2] * np.random.default_rng(1).normal(size=(200, 2))
    assert quiet_fit(data.with_force(force)).noise.deviation[1] == pytest.approx(0.2, rel=0.2)


@pytest.mark.parametrize("unit", [1e-3, 0.1, 30.0, 1e3])
def test_the_unit_of_a_motor_does_not_choose_whom_estimates_believe(unit):
    """Two motors contradict each other, as with other gains: either may be believed."""
    rng = np.random.default_rng(0)
    W = rng.normal(size=(60, 2, 4))
    force = W @ TRUTH * np.array([1.0, 3.0]) + 0.1 * rng.normal(size=(60, 2))
    scale = np.array([1.0, unit])
    one, other = (
        WeightedLeastSquares().fit(named_samples(W * s[:, None], force * s).problem)
        for s in (np.ones(2), scale)
    )
    np.testing.assert_allclose(other.values, one.values, rtol=1e-6)
    np.testing.assert_allclose(other.weights * scale, one.weights, rtol=1e-6)
