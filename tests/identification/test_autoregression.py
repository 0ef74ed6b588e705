"""Autoregressive models, against the dense matrices they stand for."""

from itertools import pairwise

import numpy as np
import pytest
import scipy
from hypothesis import given, strategies as st
from scipy.linalg import block_diag, toeplitz

from loopid.identification.correlation import (
    LARGEST_ORDER,
    LARGEST_REFLECTION,
    Autoregression,
    ErrorModel,
    Spectra,
    burg_covariances,
    means_of_series,
    pairs_apart,
)

reflections = st.lists(st.floats(-0.9, 0.9), min_size=0, max_size=6)


def model_of(reflected, variance=2.0):
    polynomial = np.ones(1)
    for k in reflected:
        longer = np.append(polynomial, 0.0)
        polynomial = longer + k * longer[::-1]
    return Autoregression.of_coefficients(-polynomial[1:], variance)


def long_covariances(model, count):
    """Autocovariances at lags 0 to count - 1, by summing the impulse response."""
    response = scipy.signal.lfilter([1.0], model.polynomial, np.append(1.0, np.zeros(20_000)))
    total = [response[: len(response) - k] @ response[k:] for k in range(count)]
    return model.variance * np.array(total)


@given(reflections)
def test_covariances_are_those_of_the_process(reflected):
    model = model_of(reflected)
    np.testing.assert_allclose(
        model.covariances, long_covariances(model, model.order + 1), rtol=1e-6, atol=1e-8
    )


@given(reflections)
def test_models_of_coefficients_and_of_covariances_are_the_same(reflected):
    model = model_of(reflected)
    again = Autoregression.of_covariances(model.covariances)
    np.testing.assert_allclose(again.coefficients, model.coefficients, rtol=1e-9, atol=1e-9)
    assert again.variance == pytest.approx(model.variance, rel=1e-9)


@given(reflections, st.sampled_from([(60,), (40, 20), (1, 2, 3, 54)]))
def test_products_of_spectra_are_those_with_the_dense_covariance(reflected, lengths):
    ends = np.cumsum([0, *lengths])
    pieces = tuple(slice(*pair) for pair in pairwise(ends.tolist()))
    model = model_of(reflected)
    lags = long_covariances(model, 60)
    dense = block_diag(*(toeplitz(lags[:length]) for length in lengths))
    spectra = Spectra.of(np.eye(60), pieces)
    np.testing.assert_allclose(spectra.turned(spectra.densities(model)), dense, atol=1e-6 * lags[0])
    covariance = spectra.covariance(spectra.densities(model))
    np.testing.assert_allclose(covariance, dense, atol=1e-6 * lags[0])
    present = np.arange(60) % 7 != 2
    variance = model.sum_variance(pairs_apart(present, pieces))
    assert variance == pytest.approx(present @ dense @ present, abs=1e-3 * lags[0])


def test_means_of_several_series_are_those_of_each():
    rng, pieces = np.random.default_rng(0), (slice(0, 300), slice(300, 400))
    used = rng.random(400) < 0.9
    series = scipy.signal.lfilter([1.0], [1.0, -0.8], rng.normal(size=(3, 400))) * used
    series[1] = 0.0
    found = means_of_series(series, used, pieces)
    alone = [means_of_series(each[None], used, pieces) for each in series]
    np.testing.assert_allclose(found, np.concatenate(alone, axis=1), rtol=1e-9)
    np.testing.assert_allclose(found[0], series[:, used].mean(axis=1))
    assert found[1][1] == 0.0
    assert found[1][0] == pytest.approx(5 / np.sqrt(used.sum()), rel=0.4)


@given(reflections, st.integers(0, 1000))
def test_what_a_fit_takes_up_is_what_residuals_lack(reflected, seed):
    rng, pieces = np.random.default_rng(seed), (slice(0, 40), slice(40, 60))
    used = rng.random(60) < 0.8
    columns, _ = np.linalg.qr(rng.normal(size=(60, 4)) * used[:, None])
    polynomial = model_of(reflected).polynomial
    residual = scipy.signal.lfilter([1.0], polynomial, rng.normal(size=560))[500:]
    errors = ErrorModel(columns, residual, used, pieces)
    model = errors.model
    lags = long_covariances(model, 40)
    omega = block_diag(toeplitz(lags), toeplitz(lags[:20]))
    project = np.eye(60) - columns @ columns.T
    lacking = omega - project @ omega @ project
    same = block_diag(np.ones((40, 40)), np.ones((20, 20))) * np.outer(used, used)
    expected = [np.trace(lacking * same, k) for k in range(model.order + 1)]
    found = errors.taken_up(columns.T @ omega @ columns)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(errors.sums, columns.T @ omega @ columns, rtol=1e-6, atol=1e-6)


def test_impossible_covariances_end_at_the_limit():
    model = Autoregression.of_covariances(np.array([1.0, 1.1, 0.2]))
    np.testing.assert_allclose(model.coefficients, [LARGEST_REFLECTION])
    assert model.variance > 0


def test_the_order_and_model_are_found():
    rng = np.random.default_rng(0)
    truth = np.poly([0.9, 0.6 * np.exp(1j), 0.6 * np.exp(-1j)]).real
    errors = scipy.signal.lfilter([1.0], truth, rng.normal(size=21_000))[1000:]
    model = Autoregression.of_covariances(burg_covariances(errors, np.arange(1, 20_001)))
    expected = long_covariances(Autoregression.of_coefficients(-truth[1:], 1.0), 4)
    np.testing.assert_allclose(model.covariances[:4], expected, rtol=0.1)
    assert model.variance == pytest.approx(1.0, rel=0.06)
    assert model.order < 12
    white = burg_covariances(rng.normal(size=20_000), np.arange(1, 20_001))
    assert len(white) == 1


@pytest.mark.parametrize("cutoff", [0.4, 0.1, 0.03])
def test_models_of_filtered_errors_keep_the_slow_part(cutoff):
    # What matters to smooth motion: the variance of sums over long times, 1 before and after.
    rng = np.random.default_rng(1)
    lowpass = scipy.signal.butter(2, cutoff, output="sos")
    errors = scipy.signal.sosfiltfilt(lowpass, rng.normal(size=20_000))
    covariances = burg_covariances(errors, np.arange(1, 20_001))
    model = Autoregression.of_covariances(covariances)
    assert model.order <= LARGEST_ORDER
    assert model.variance / model.polynomial.sum() ** 2 == pytest.approx(1.0, abs=0.35)
    assert np.abs(np.roots(model.polynomial)).max() < 1


def test_few_or_vanishing_errors_make_a_model_too():
    assert len(burg_covariances(np.zeros(50), np.arange(1, 51))) == 1
    assert len(burg_covariances(np.ones(3), np.arange(1, 4))) == 1
    constant = Autoregression.of_covariances(burg_covariances(np.ones(500), np.arange(1, 501)))
    assert np.isfinite(constant.covariances).all()
