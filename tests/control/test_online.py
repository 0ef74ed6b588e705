"""Recursive least squares against batch fits, forgetting, and changes."""

import warnings

import numpy as np
import pytest

import loopid
from loopid.control import ChangeDetector, RecursiveLeastSquares
from loopid.errors import DataError, OptionError, RankError
from made_runs import quietly

N, DOF = 23, 4


@pytest.fixture(scope="module")
def data():
    """Rows of a well and a badly excited half, true values, and forces with noise."""
    rng = np.random.default_rng(0)
    phi, sigma = 5 * rng.standard_normal(N), np.array([7.0, 1.0, 3.0, 20.0])
    K = rng.standard_normal((400, DOF, N)) * np.geomspace(1, 1e-3, N)
    return K, phi, sigma, K @ phi + sigma * rng.standard_normal((400, DOF))


def taken(estimate, K, force):
    for row, value in zip(K, force, strict=True):
        estimate.update(row, value)
    return estimate


def batch(K, force, sigma, root=None, values=None, weights=None):
    """Weighted least squares by one factorisation, with a prior root R φ = R values."""
    weights = np.ones(len(K)) if weights is None else weights
    rows = (K / sigma[:, None] * weights[:, None, None]).reshape(-1, K.shape[2])
    right = (force / sigma * weights[:, None]).ravel()
    if root is not None:
        rows, right = np.concatenate([root, rows]), np.concatenate([root @ values, right])
    return np.linalg.lstsq(rows, right, rcond=None)[0]


def close(found, expected, tolerance):
    assert np.linalg.norm(found - expected) <= tolerance * np.linalg.norm(expected)


def test_without_forgetting_it_is_the_batch_fit(data):
    K, _, sigma, force = data
    nothing = taken(RecursiveLeastSquares(np.zeros(N), None, sigma), K, force)
    close(nothing.values, batch(K, force, sigma), 1e-9)
    start, spread = np.ones(N), np.diag(np.linspace(1, 4, N))
    prior = taken(RecursiveLeastSquares(start, spread, sigma), K, force)
    root = np.diag(1 / np.sqrt(spread.diagonal()))
    close(prior.values, batch(K, force, sigma, root, start), 1e-9)
    rows = (K / sigma[:, None]).reshape(-1, N)
    close(prior.covariance, np.linalg.inv(root.T @ root + rows.T @ rows), 1e-9)


def test_exponential_forgetting_weighs_samples_by_their_age(data):
    K, _, sigma, force = data
    kind = {"forgetting": "exponential", "memory": 100.0}
    found = taken(RecursiveLeastSquares(np.zeros(N), None, sigma, **kind), K, force)
    weights = 0.99 ** (np.arange(len(K))[::-1] / 2)
    close(found.values, batch(K, force, sigma, weights=weights), 1e-8)


def test_directional_forgetting_with_full_excitation_is_exponential():
    """With as many forces as parameters a sample tells all directions."""
    rng = np.random.default_rng(1)
    K, force = rng.standard_normal((50, 3, 3)) + 3 * np.eye(3), rng.standard_normal((50, 3))
    found = [
        taken(
            RecursiveLeastSquares(np.zeros(3), np.eye(3), np.ones(3), forgetting=kind, memory=20.0),
            K,
            force,
        ).values
        for kind in ("exponential", "directional")
    ]
    close(found[1], found[0], 1e-9)


def test_only_directional_forgetting_bears_missing_excitation(data):
    K, _, sigma, force = data
    rng = np.random.default_rng(2)
    told = np.linalg.qr(rng.standard_normal((N, 3)))[0].T
    widest = {}
    for kind in ("none", "exponential", "directional"):
        start = RecursiveLeastSquares(
            np.zeros(N), 1e6 * np.eye(N), sigma, forgetting=kind, memory=100.0
        )
        estimate = taken(start, K, force)
        before = estimate.covariance.diagonal().max()
        rows = rng.standard_normal((3000, DOF, 3)) @ told
        taken(estimate, rows, rows @ np.ones(N))
        if kind == "exponential":
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                widest[kind] = estimate.covariance.diagonal().max() / before
            continue
        C = estimate.covariance
        assert np.linalg.eigvalsh(C).min() > 0
        widest[kind] = C.diagonal().max() / before
        # What is told follows the new data, the rest stays.
        close(told @ estimate.values, told @ np.ones(N), 0.2)
        if kind == "directional":
            close(told @ estimate.values, told @ np.ones(N), 1e-3)
    assert widest["none"] <= 1
    assert widest["directional"] < 3
    assert widest["exponential"] > 1e6


def test_innovations_are_chi_squared_and_rows_of_zeros_do_not_count(data):
    K, phi, sigma, _ = data
    rng, counts, seen = np.random.default_rng(3), [], []
    start = np.linalg.cholesky(np.diag(np.linspace(0.1, 2, N)))
    for _ in range(300):
        truth = phi + start @ rng.standard_normal(N)
        estimate = RecursiveLeastSquares(phi, start @ start.T, sigma)
        row = K[0] * np.array([1, 1, 0, 1])[:, None]
        value, count = estimate.innovation(row, row @ truth + sigma * rng.standard_normal(DOF))
        seen.append(value)
        counts.append(count)
    assert set(counts) == {3}
    assert abs(np.mean(seen) - 3) < 4 * np.sqrt(6 / 300)


def test_loosening_widens_the_given_columns_and_keeps_the_values(data):
    K, _, sigma, force = data
    estimate = taken(RecursiveLeastSquares(np.zeros(N), np.eye(N), sigma), K, force)
    values, C = estimate.values, estimate.covariance
    columns = np.random.default_rng(4).standard_normal((N, 2))
    estimate.loosen(columns, np.array([2.0, 0.5]))
    close(estimate.values, values, 1e-9)
    close(estimate.covariance, C + (columns * [4.0, 0.25]) @ columns.T, 1e-9)


def test_a_detector_is_silent_without_and_quick_with_a_change():
    rng = np.random.default_rng(5)
    detector = ChangeDetector()
    assert not any(detector.update(x, 4) for x in rng.chisquare(4, 100_000))
    late = next(k for k in range(100) if detector.update(30.0 + rng.chisquare(4), 4))
    assert late < 8
    assert not ChangeDetector().update(1e9, 0)  # nothing was measured


def test_what_cannot_be_is_refused():
    with pytest.raises(RankError, match="begin with a covariance"):
        _ = RecursiveLeastSquares(np.zeros(2), None, np.ones(1)).values
    for covariance in (np.eye(3), -np.eye(2)):
        with pytest.raises(DataError, match="covariance"):
            RecursiveLeastSquares(np.zeros(2), covariance, np.ones(1))
    with pytest.raises(DataError, match="deviations"):
        RecursiveLeastSquares(np.zeros(2), np.eye(2), np.zeros(1))
    with pytest.raises(OptionError, match="memory"):
        RecursiveLeastSquares(np.zeros(2), np.eye(2), np.ones(1), memory=0.5)
    with pytest.raises(OptionError, match="drift"):
        ChangeDetector(drift=0.5)


@pytest.mark.validate
def test_online_is_the_batch_fit_of_the_real_log(knee, recording_of):
    model = loopid.force_model(knee, "gravity", "Fc,Fv")
    samples = model.samples(recording_of(knee))
    fit = quietly(loopid.identification.fit, samples)
    sigma = 1 / fit.weights
    K, force = samples.regressor * samples.used[..., None], samples.force * samples.used
    online = RecursiveLeastSquares(np.zeros(len(fit.values)), None, sigma)
    close(taken(online, K, force).values, fit.values, 1e-9)
