"""What a fit states when errors follow one another, and what it warns of."""

import warnings

import numpy as np
import pytest
from scipy.linalg import block_diag, toeplitz

from loopid.errors import CorrelationWarning, ExcitationWarning, OptionError
from loopid.identification import OrdinaryLeastSquares, WeightedLeastSquares, fit
from loopid.identification.autoregression import Autoregression
from loopid.identification import quiet_fit

DEVIATIONS = np.array([0.5, 4.0])
TRUTH = np.array([3.0, -1.0, 0.5, 10.0, 2.0, -4.0])


def stretches_of(samples, parts=3):
    return np.arange(samples) * parts // samples


def omega_of(result, samples, i):
    """The dense covariance matrix of one actuator's errors."""
    noise = result.noise
    model = Autoregression(noise.coefficients[i], noise.innovation[i] ** 2)
    longest = max(np.bincount(samples.stretches))
    lags = np.append(model.covariances, np.zeros(longest))
    for t in range(model.order + 1, longest):
        lags[t] = model.coefficients @ lags[t - 1 : t - model.order - 1 : -1]
    counts = np.bincount(samples.stretches)
    return block_diag(*(toeplitz(lags[:count]) for count in counts))


@pytest.mark.parametrize("estimator", ["ols", "wls"])
def test_the_covariance_is_the_dense_sandwich(make_regressor, make_errors, make_samples, estimator):
    W, rng = make_regressor(samples=300), np.random.default_rng(0)
    used = rng.random((300, 2)) < 0.8
    force = W @ TRUTH + make_errors(rng, (300, 2), 0.8) * DEVIATIONS
    samples = make_samples(W, force, used, stretches_of(300))
    result = quiet_fit(samples, estimator)
    bread = meat = 0.0
    for i, weight in enumerate(result.weights):
        X = weight * W[:, i] * used[:, i, None]
        bread = bread + X.T @ X
        meat = meat + weight**2 * X.T @ omega_of(result, samples, i) @ X
    inverse = np.linalg.inv(bread)
    np.testing.assert_allclose(result.covariance, inverse @ meat @ inverse, rtol=1e-6)


def test_white_errors_give_the_covariance_of_independent_ones(make_regressor, make_samples):
    W, rng = make_regressor(samples=200), np.random.default_rng(0)
    samples = make_samples(W, W @ TRUTH + rng.normal(size=(200, 2)) * DEVIATIONS)
    result, plain = quiet_fit(samples), WeightedLeastSquares().fit(samples.problem)
    assert (result.noise.orders == 0).all()
    np.testing.assert_allclose(result.covariance, plain.covariance, rtol=1e-9)
    assert result.degrees_of_freedom == plain.degrees_of_freedom
    np.testing.assert_array_equal(result.noise.effective_samples, result.noise.samples)
    np.testing.assert_allclose(result.noise.deviation, 1 / plain.weights, rtol=1e-9)


def test_few_white_errors_give_exactly_the_covariance_of_independent_ones(make_samples):
    rng = np.random.default_rng(1)
    samples = make_samples(rng.normal(size=(8, 2, 6)), rng.normal(size=(8, 2)))
    result, plain = quiet_fit(samples), WeightedLeastSquares().fit(samples.problem)
    np.testing.assert_allclose(result.covariance, plain.covariance, rtol=1e-9)


def test_errors_that_swing_are_worth_no_more_than_their_number(
    make_regressor, make_errors, make_samples
):
    W, errors = make_regressor(), make_errors(np.random.default_rng(0), (1000, 2), -0.9)
    noise = quiet_fit(make_samples(W, errors)).noise
    assert (noise.lag_one < -0.8).all()
    np.testing.assert_array_equal(noise.effective_samples, noise.samples)


def test_the_model_of_the_errors_is_found(make_regressor, make_errors, make_samples):
    W, rng = make_regressor(samples=4000), np.random.default_rng(3)
    force = W @ TRUTH + make_errors(rng, (4000, 2), 0.9) * DEVIATIONS
    noise = quiet_fit(make_samples(W, force)).noise
    np.testing.assert_allclose(noise.deviation, DEVIATIONS, rtol=0.15)
    np.testing.assert_allclose(noise.innovation, DEVIATIONS * np.sqrt(1 - 0.81), rtol=0.05)
    np.testing.assert_allclose(noise.lag_one, 0.9, atol=0.02)
    np.testing.assert_allclose(noise.effective_samples, 4000 * 0.1 / 1.9, rtol=0.25)


def test_slow_errors_are_told_in_one_sentence(make_regressor, make_errors, make_samples):
    W, rng = make_regressor(samples=2000), np.random.default_rng(0)
    errors = make_errors(rng, (2000, 2), 0.95) * [0.1, 0.0] + rng.normal(size=(2000, 2)) * [0, 0.1]
    samples = make_samples(W, W @ TRUTH + errors)
    with pytest.warns(CorrelationWarning) as caught:
        result = fit(samples)
    (message,) = [str(warning.message) for warning in caught]
    assert "the errors of a (lag-one autocorrelation 0.9" in message
    assert f"{result.noise.effective_samples[0]:.0f} effective of 2000 samples" in message
    assert "times as wide" in message
    assert "b (" not in message


def test_parameters_near_zero_are_named_once(make_regressor, make_samples):
    W, rng = make_regressor(samples=200), np.random.default_rng(0)
    truth = TRUTH * [1, 1, 0, 1, 0, 1]
    with pytest.warns(ExcitationWarning, match=r"2 of 6 .* link2\.m \(\d+ %\), link4\.m") as caught:
        result = fit(make_samples(W, W @ truth + 0.1 * rng.normal(size=(200, 2))))
    assert len(caught) == 1
    assert result.unsupported() == ("link2.m", "link4.m")
    assert result.unsupported(limit=1e-9) == result.parameters.labels
    assert result.unsupported(limit=1e9) == ()
    with pytest.raises(OptionError, match="limit"):
        result.unsupported(limit=0.0)


def test_good_data_warn_of_nothing(make_regressor, make_samples):
    W, rng = make_regressor(samples=200), np.random.default_rng(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fit(make_samples(W, W @ TRUTH + 0.01 * rng.normal(size=(200, 2))))


@pytest.mark.filterwarnings("ignore::loopid.errors.ExcitationWarning")
def test_too_few_effective_samples_tell_no_interval(make_regressor, make_errors, make_samples):
    W, rng = make_regressor(samples=200, count=14, harmonics=8), np.random.default_rng(2)
    samples = make_samples(W, make_errors(rng, (200, 2), 0.999, lead=20_000))
    with pytest.warns(CorrelationWarning, match="too few effective"):
        result = fit(samples)
    assert result.degrees_of_freedom < 1
    assert np.isinf(result.intervals()).all()
    assert len(result.unsupported()) == 14


@pytest.mark.parametrize("make", [np.zeros_like, lambda force: force])
def test_data_without_errors_are_fitted_without_doubt(make_regressor, make_samples, make):
    W = make_regressor(samples=200)
    result = quiet_fit(make_samples(W, make(W @ TRUTH)), "ols")
    assert np.isfinite(result.covariance).all()
    assert result.standard_errors.max() < 1e-9
    assert (result.noise.orders == 0).all()


def test_an_absent_actuator_has_no_error_model(make_regressor, make_errors, make_samples):
    W, rng = make_regressor(samples=500), np.random.default_rng(0)
    used = np.ones((500, 2), dtype=bool) & [True, False]
    force = W @ TRUTH + make_errors(rng, (500, 2), 0.9)
    result = quiet_fit(make_samples(W, force, used))
    alone = quiet_fit(make_samples(W[:, :1], force[:, :1]))
    np.testing.assert_allclose(result.covariance, alone.covariance, rtol=1e-8)
    assert result.degrees_of_freedom == pytest.approx(alone.degrees_of_freedom)
    assert result.noise.effective_samples[1] == 0
    assert np.isnan([result.noise.deviation[1], result.noise.lag_one[1]]).all()


def test_estimators_are_chosen_by_name_or_given(make_regressor, make_samples):
    W, rng = make_regressor(samples=200), np.random.default_rng(0)
    samples = make_samples(W, W @ TRUTH + 0.1 * rng.normal(size=(200, 2)))
    assert fit(samples, OrdinaryLeastSquares()) == fit(samples, "ols")
    assert fit(samples).estimator == "wls"
    with pytest.raises(
        OptionError, match="unknown estimator 'lms': choose one of ols, wls, huber, b"
    ):
        fit(samples, "lms")
