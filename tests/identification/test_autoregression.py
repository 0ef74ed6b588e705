"""Autoregressive models, against the dense matrices they stand for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag, toeplitz
from scipy.signal import butter, lfilter, sosfiltfilt

from loopid.identification.autoregression import Autoregression
from loopid.identification.burg import LARGEST_ORDER, burg_covariances, run_lengths

reflections = st.lists(st.floats(-0.95, 0.95), min_size=0, max_size=6)


def model_of(reflected, variance=2.0):
    polynomial = np.ones(1)
    for k in reflected:
        longer = np.append(polynomial, 0.0)
        polynomial = longer + k * longer[::-1]
    return Autoregression(-polynomial[1:], variance)


def long_covariances(model, count):
    """Autocovariances at lags 0 to count - 1, by summing the impulse response."""
    response = lfilter([1.0], model.polynomial, np.append(1.0, np.zeros(4000)))
    total = [response[: len(response) - k] @ response[k:] for k in range(count)]
    return model.variance * np.array(total)


@given(reflections)
def test_covariances_are_those_of_the_process(reflected):
    model = model_of(reflected)
    np.testing.assert_allclose(
        model.covariances(), long_covariances(model, model.order + 1), rtol=1e-6, atol=1e-8
    )


@given(reflections)
def test_a_model_has_the_covariances_it_was_made_of(reflected):
    model = model_of(reflected)
    again = Autoregression.of_covariances(model.covariances())
    np.testing.assert_allclose(again.coefficients, model.coefficients, rtol=1e-5, atol=1e-7)
    assert again.variance == pytest.approx(model.variance, rel=1e-5)


@given(reflections, st.integers(0, 1000))
def test_sums_have_the_covariance_of_the_dense_matrix(reflected, seed):
    model, rng = model_of(reflected), np.random.default_rng(seed)
    parts = [rng.normal(size=(length, 3)) for length in (40, 1, 7)]
    lags = long_covariances(model, 40)
    omega = block_diag(*(toeplitz(lags[: len(part)]) for part in parts))
    X = np.concatenate(parts)
    expected = X.T @ omega @ X
    scale = np.abs(expected).max()
    np.testing.assert_allclose(model.sum_covariance(parts), expected, atol=1e-6 * scale)


@given(reflections, st.integers(0, 1000))
def test_lagged_sums_are_those_of_the_dense_matrix(reflected, seed):
    # Padded with zeros, so that shifting the columns loses none of them.
    model, rng = model_of(reflected), np.random.default_rng(seed)
    X = rng.normal(size=(30, 2))
    X[:8] = X[-8:] = 0.0
    omega = toeplitz(long_covariances(model, 30))
    expected = [np.sum(X * (omega @ np.roll(X, k, axis=0))) for k in range(model.order + 1)]
    found = model.lagged_sums([X])
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_impossible_covariances_end_at_the_limit():
    model = Autoregression.of_covariances(np.array([1.0, 0.9999, 0.2]), limit=0.99)
    np.testing.assert_allclose(model.coefficients, [0.99])
    assert model.variance > 0


def test_the_order_and_model_are_found():
    rng = np.random.default_rng(0)
    truth = np.poly([0.9, 0.6 * np.exp(1j), 0.6 * np.exp(-1j)]).real
    errors = lfilter([1.0], truth, rng.normal(size=21_000))[1000:]
    model = Autoregression.of_covariances(burg_covariances(errors, np.arange(1, 20_001)))
    expected = long_covariances(Autoregression(-truth[1:], 1.0), 4)
    np.testing.assert_allclose(model.covariances()[:4], expected, rtol=0.1)
    assert model.variance == pytest.approx(1.0, rel=0.06)
    assert model.order < 12
    white = burg_covariances(rng.normal(size=20_000), np.arange(1, 20_001))
    assert len(white) == 1


def test_gaps_are_never_predicted_across(make_errors):
    rng = np.random.default_rng(0)
    errors = make_errors(rng, (30_000,), 0.9)
    used = rng.random(30_000) < 0.9
    pieces = (slice(0, 100), slice(100, 30_000))
    spoilt = np.where(used, errors, 1e9)
    model = Autoregression.of_covariances(burg_covariances(spoilt, run_lengths(used, pieces)))
    assert model.covariances()[0] == pytest.approx(1.0, rel=0.1)
    assert model.covariances()[1] / model.covariances()[0] == pytest.approx(0.9, abs=0.02)


def test_runs_end_at_gaps_and_stretches():
    used = np.array([1, 1, 0, 1, 1, 1, 1, 0], dtype=bool)
    runs = run_lengths(used, (slice(0, 5), slice(5, 8)))
    np.testing.assert_array_equal(runs, [1, 2, 0, 1, 2, 1, 2, 0])


@pytest.mark.parametrize("cutoff", [0.4, 0.1, 0.03])
def test_models_of_filtered_errors_keep_the_slow_part(cutoff):
    # What matters to smooth motion: the variance of sums over long times, 1 before and after.
    rng = np.random.default_rng(1)
    errors = sosfiltfilt(butter(2, cutoff, output="sos"), rng.normal(size=20_000))
    covariances = burg_covariances(errors, np.arange(1, 20_001))
    model = Autoregression.of_covariances(covariances)
    assert model.order <= LARGEST_ORDER
    assert model.variance / model.polynomial.sum() ** 2 == pytest.approx(1.0, abs=0.35)
    assert np.abs(np.roots(model.polynomial)).max() < 1


def test_few_or_vanishing_errors_make_a_model_too():
    assert len(burg_covariances(np.zeros(50), np.arange(1, 51))) == 1
    assert len(burg_covariances(np.ones(3), np.arange(1, 4))) == 1
    constant = Autoregression.of_covariances(burg_covariances(np.ones(500), np.arange(1, 501)))
    assert np.isfinite(constant.covariances()).all()
