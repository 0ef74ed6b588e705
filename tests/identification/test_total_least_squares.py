"""Errors in the regressor: the definition by singular values, and a Monte Carlo."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid.errors import DataError, OptionError, RankError
from loopid.identification import FitSamples, TotalLeastSquares, quiet_fit
from smooth_data import assert_coverage, covered, named_samples, runs, smooth_regressor

TRUTH = np.array([3.0, -1.0, 0.5, 1.0, 2.0, -4.0])


def make_run(seed=0, count=200, noise=0.3):
    """Errors of one size in all entries of the regressor and the forces."""
    W, rng = smooth_regressor(samples=count), np.random.default_rng(seed)
    measured = W + noise * rng.normal(size=W.shape)
    return named_samples(measured, W @ TRUTH + noise * rng.normal(size=W.shape[:2]))


def by_definition(samples, sizes):
    """The least correction of [X D⁻¹ | y] that makes it singular."""
    flat = np.column_stack([samples.regressor.reshape(-1, 6) / sizes, samples.force.ravel()])
    last = np.linalg.svd(flat, full_matrices=False)[2][-1]
    return -last[:-1] / last[-1] / sizes


@given(st.integers(0, 1000))
def test_estimates_are_those_of_the_definition(seed):
    sizes = np.random.default_rng(seed).uniform(0.2, 2.0, 6)
    samples = make_run(seed, 40)
    found = TotalLeastSquares().fit(samples.problem).values
    np.testing.assert_allclose(found, by_definition(samples, np.ones(6)), rtol=1e-8)
    found = TotalLeastSquares(sizes).fit(samples.problem).values
    np.testing.assert_allclose(found, by_definition(samples, sizes), rtol=1e-8)


def test_the_covariance_of_independent_errors_is_the_textbooks():
    samples, sizes = make_run(), np.array([0.5, 2.0, 1.0, 0.0, 1.0, 1.5])
    result = TotalLeastSquares(sizes).fit(samples.problem)
    X, y, phi = samples.regressor.reshape(-1, 6), samples.force.ravel(), result.values
    residual, spread = y - X @ phi, 1 + (sizes * phi) @ (sizes * phi)
    bread = np.linalg.inv(X.T @ X - (residual @ residual) / spread * np.diag(sizes**2))
    corrected = X + np.outer(residual, sizes**2 * phi / spread)
    variance = residual @ residual / (len(y) - 6)
    expected = variance * bread @ corrected.T @ corrected @ bread
    np.testing.assert_allclose(result.covariance, expected, rtol=1e-6)
    np.testing.assert_allclose(corrected.T @ residual, 0.0, atol=1e-8 * np.linalg.norm(y))


def test_exact_columns_are_the_limit_of_small_errors():
    samples = make_run()
    sizes = np.array([1.0, 0.0, 1.0, 0.0, 1.0, 1.0])
    exact = TotalLeastSquares(sizes).fit(samples.problem)
    limit = by_definition(samples, np.where(sizes > 0, sizes, 1e-6))
    np.testing.assert_allclose(exact.values, limit, rtol=1e-7)
    none = TotalLeastSquares(np.zeros(6)).fit(samples.problem)
    np.testing.assert_allclose(none.values, quiet_fit(samples, "ols").values, rtol=1e-9)
    np.testing.assert_allclose(
        quiet_fit(samples, TotalLeastSquares(np.zeros(6))).covariance,
        quiet_fit(samples, "ols").covariance,
        rtol=1e-8,
    )


def test_force_errors_weigh_the_actuators():
    samples, sizes = make_run(), np.array([0.5, 2.0])
    found = TotalLeastSquares(force_errors=sizes).fit(samples.problem)
    data = samples.parameters, samples.actuators
    scaled = FitSamples.of(*data, samples.regressor / sizes[:, None], samples.force / sizes)
    np.testing.assert_allclose(found.values, by_definition(scaled, np.ones(6)), rtol=1e-8)


def test_without_errors_the_truth_comes_out():
    W = smooth_regressor()
    found = TotalLeastSquares().fit(named_samples(W, W @ TRUTH).problem)
    np.testing.assert_allclose(found.values, TRUTH, rtol=1e-9)


@runs(25, 100)
def test_it_is_consistent_and_covers_where_least_squares_is_biased(runs):
    data = [make_run(seed) for seed in range(runs)]
    fits = {name: [quiet_fit(one, name) for one in data] for name in ("ols", "tls")}
    found = {name: np.array([fit.values for fit in several]) for name, several in fits.items()}
    error = {name: np.abs(values.mean(axis=0) - TRUTH) for name, values in found.items()}
    deviation = {name: values.std(axis=0) / np.sqrt(runs) for name, values in found.items()}
    assert (error["tls"] < 4 * deviation["tls"]).all()
    assert (error["ols"] > np.sqrt(runs) * deviation["ols"]).any()
    stated = np.mean([fit.standard_errors for fit in fits["tls"]], axis=0)
    np.testing.assert_allclose(stated / found["tls"].std(axis=0), 1.0, atol=2.8 / np.sqrt(runs))
    assert_coverage([covered(fit, TRUTH) for fit in fits["tls"]])


def test_problems_without_one_solution_are_refused():
    samples = make_run()
    noise = np.random.default_rng(0).normal(size=samples.regressor.shape)
    orthogonal = noise.reshape(-1, 6)
    force = np.linalg.qr(np.column_stack([orthogonal, 9 * noise[:, :, 0].ravel() ** 2]))[0][:, -1]
    blind = named_samples(noise, 1e3 * force.reshape(noise.shape[:2]))
    with pytest.raises(RankError, match="no single solution"):
        quiet_fit(blind, "tls")


@pytest.mark.parametrize(
    ("options", "failure", "word"),
    [
        ({"column_errors": np.full(6, -1.0)}, OptionError, "from 0 on"),
        ({"column_errors": np.ones(5)}, DataError, r"shape \(6,\)"),
        ({"column_errors": np.full(6, np.nan)}, DataError, "finite"),
        ({"force_errors": np.zeros(2)}, OptionError, "above 0"),
        ({"force_errors": np.ones(3)}, DataError, r"shape \(2,\)"),
    ],
)
def test_errors_that_are_none_are_refused(options, failure, word):
    with pytest.raises(failure, match=word):
        TotalLeastSquares(**options).fit(make_run().problem)
