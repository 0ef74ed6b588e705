"""Least squares on factors: the textbook's estimates, and intervals that cover."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid import ParameterSet
from loopid.errors import DataError, OptionError, RankError
from loopid.identification import FitProblem, OrdinaryLeastSquares, WeightedLeastSquares

ACTUATORS = ("a", "b", "c")
DEVIATIONS = np.array([0.5, 2.0, 8.0])
TRUTH = np.array([3.0, -1.0, 0.5, 10.0])
NAMES = ParameterSet.from_labels([f"link{j}.m" for j in range(4)])
ESTIMATORS = (OrdinaryLeastSquares(), WeightedLeastSquares())


def regressor(seed=0, samples=60):
    return np.random.default_rng(seed).normal(size=(samples, 3, 4))


def measured(W, seed=1, deviations=DEVIATIONS):
    return W @ TRUTH + np.random.default_rng(seed).normal(size=W.shape[:2]) * deviations


def problem(W, force):
    return FitProblem.from_samples(W, force, NAMES, ACTUATORS)


@given(st.integers(0, 10_000))
def test_ordinary_estimates_and_errors_are_the_textbooks(seed):
    W = regressor(seed)
    tau = measured(W, seed + 1)
    found = OrdinaryLeastSquares().fit(problem(W, tau))
    flat, rhs = W.reshape(-1, 4), tau.ravel()
    expected, squares, *_ = np.linalg.lstsq(flat, rhs)
    np.testing.assert_allclose(found.values, expected, rtol=1e-9)
    variance = squares[0] / (len(rhs) - 4)
    covariance = variance * np.linalg.inv(flat.T @ flat)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-8, atol=1e-12)
    assert found.condition_number == pytest.approx(np.linalg.cond(flat))


def test_quality_is_that_of_the_residuals():
    W = regressor()
    tau = measured(W)
    for estimator in ESTIMATORS:
        found = estimator.fit(problem(W, tau))
        residual = tau - found.predict(W)
        np.testing.assert_allclose(found.quality.residual_rms, np.sqrt((residual**2).mean(0)))
        expected = 1 - (residual**2).sum(0) / ((tau - tau.mean(0)) ** 2).sum(0)
        np.testing.assert_allclose(found.quality.r_squared, expected)
        other = problem(regressor(5), measured(regressor(5), 6))
        residual = measured(regressor(5), 6) - found.predict(regressor(5))
        validated = found.validate(other)
        np.testing.assert_allclose(validated.residual_rms, np.sqrt((residual**2).mean(0)))


def test_weights_settle_at_the_inverse_deviations():
    W = regressor(samples=4000)
    found = WeightedLeastSquares().fit(problem(W, measured(W)))
    np.testing.assert_allclose(found.quality.residual_rms, DEVIATIONS, rtol=0.05)
    flat = (W / found.quality.residual_rms[:, None]).reshape(-1, 4)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(flat.T @ flat), rtol=1e-3, atol=1e-9)


def test_parts_of_a_log_give_the_same_fit_as_the_whole():
    W = regressor(samples=100)
    tau = measured(W)
    parts = [problem(W[k : k + 23], tau[k : k + 23]) for k in range(0, 100, 23)]
    for estimator in ESTIMATORS:
        whole, joined = (estimator.fit(p) for p in (problem(W, tau), FitProblem.combined(parts)))
        np.testing.assert_allclose(joined.values, whole.values, rtol=1e-9)
        np.testing.assert_allclose(joined.covariance, whole.covariance, rtol=1e-8)
        np.testing.assert_allclose(joined.quality.r_squared, whole.quality.r_squared)


@pytest.fixture(scope="module")
def repeated():
    """Fits of 500 seeded repetitions: estimator name to values and intervals."""
    W = regressor()
    runs = [problem(W, measured(W, seed)) for seed in range(100, 600)]
    return {e.name: [e.fit(run) for run in runs] for e in ESTIMATORS}


@pytest.mark.parametrize("name", ["ols", "wls"])
def test_estimates_are_unbiased(repeated, name):
    values = np.array([fit.values for fit in repeated[name]])
    error = np.abs(values.mean(axis=0) - TRUTH)
    assert (error < 4 * values.std(axis=0) / np.sqrt(len(values))).all()


def test_weighted_intervals_cover_at_their_rate(repeated):
    # Ordinary ones need not: they assume one variance for all actuators.
    covered = [
        (low <= TRUTH) & (high >= TRUTH)
        for low, high in (fit.intervals(0.95).T for fit in repeated["wls"])
    ]
    rates = np.mean(covered, axis=0)
    assert (rates > 0.92).all()
    assert 0.93 < rates.mean() < 0.97


def test_weights_pay_off_where_actuators_differ(repeated):
    spread = {n: np.std([fit.values for fit in repeated[n]], axis=0) for n in repeated}
    assert (spread["wls"] < 0.5 * spread["ols"]).all()


def test_intervals_widen_with_the_level():
    W = regressor()
    found = OrdinaryLeastSquares().fit(problem(W, measured(W)))
    narrow, wide = found.intervals(0.5), found.intervals(0.99)
    assert (wide[:, 0] < narrow[:, 0]).all()
    assert (wide[:, 1] > narrow[:, 1]).all()
    np.testing.assert_allclose(wide.mean(axis=1), found.values)
    relative = 100 * found.standard_errors / np.abs(found.values)
    np.testing.assert_allclose(found.relative_std, relative)


def with_twin(W):
    """The last two columns alike: only the sum of their parameters shows."""
    return np.concatenate([W[:, :, :3], W[:, :, 2:3]], axis=2)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: e.name)
@pytest.mark.parametrize(
    ("spoil", "failure", "word"),
    [
        (with_twin, RankError, "link2.m, link3.m"),
        (lambda W: W * np.array([1, 1, 0, 1]), RankError, "link2.m at all"),
        (lambda W: W[:1], DataError, "3 rows cannot determine 4"),
    ],
)
def test_what_data_do_not_tell_is_refused(estimator, spoil, failure, word):
    W = spoil(regressor())
    with pytest.raises(failure, match=word):
        estimator.fit(problem(W, measured(W)))


def test_a_perfect_actuator_leaves_no_weight():
    W = regressor()
    with pytest.raises(DataError, match="without error"):
        WeightedLeastSquares().fit(problem(W, 0 * measured(W)))


@pytest.mark.parametrize(
    ("make", "failure", "word"),
    [
        (lambda: problem(regressor()[:, :2], np.ones((60, 2))), DataError, "regressor"),
        (lambda: problem(regressor(), np.ones((59, 3))), DataError, "force"),
        (lambda: problem(regressor() * np.nan, np.ones((60, 3))), DataError, "finite"),
        (lambda: problem(regressor()[:0], np.ones((0, 3))), DataError, "no samples"),
        (lambda: FitProblem.combined([]), DataError, "combine"),
    ],
)
def test_wrong_data_are_refused(make, failure, word):
    with pytest.raises(failure, match=word):
        make()


def test_wrong_questions_to_a_result_are_refused():
    W = regressor()
    found = OrdinaryLeastSquares().fit(problem(W, measured(W)))
    with pytest.raises(OptionError, match="level"):
        found.intervals(1.0)
    with pytest.raises(DataError, match="regressor"):
        found.predict(W[:, :, :3])
    names = ParameterSet.from_labels([f"other{j}.m" for j in range(4)])
    other = FitProblem.from_samples(W, measured(W), names, ACTUATORS)
    with pytest.raises(DataError, match="validation"):
        found.validate(other)
    with pytest.raises(DataError, match="share"):
        FitProblem.combined([problem(W, measured(W)), other])
