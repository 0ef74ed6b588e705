"""Backward elimination keeps what matters; influence, and what truncation does to a fit."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from loopid.errors import DataError
from loopid.identification import OrdinaryLeastSquares, influence
from loopid.identification.fitting import quiet_fit
from loopid.identification.selection import eliminate_parameters, truncated_values
from smooth_data import DEVIATIONS, autoregressive, named_samples, outliers, runs, smooth_regressor

TRUTH = np.array([3.0, 0.0, 5.0, 0.0, 0.0, -4.0])


def make_data(seed=0, start=0.0, coefficient=0.8):
    """Training and validation samples; the parameters' distance from a start is TRUTH."""
    rng, data = np.random.default_rng(seed), []
    for k, count in enumerate((800, 600)):
        W = smooth_regressor(10 + k, count)
        errors = autoregressive(rng, (count, 2), coefficient) * DEVIATIONS
        data.append(named_samples(W, W @ (TRUTH + start) + errors, None, np.arange(count) // 200))
    return tuple(data)


@runs(6, 60)
def test_what_matters_is_kept_and_standard_errors_are_the_spread(runs):
    found = [eliminate_parameters(*make_data(seed)) for seed in range(runs)]
    assert all({0, 2, 5} <= set(one.columns) for one in found)
    assert np.mean([len(one.columns) for one in found]) < 3.7
    spread = np.std([one.steps[3].error.mean for one in found])
    stated = np.sqrt(np.mean([one.steps[3].error.standard_error ** 2 for one in found]))
    assert stated == pytest.approx(spread, rel=2.7 / np.sqrt(runs))


def test_steps_go_from_all_to_one_by_the_least_certain():
    training, validation = make_data()
    found = eliminate_parameters(training, validation)
    full = quiet_fit(training)
    assert [len(step.labels) for step in found.steps] == [6, 5, 4, 3, 2, 1]
    assert found.steps[0].dropped is None
    np.testing.assert_allclose(found.steps[0].values, full.values, rtol=1e-9)
    worst = int(full.relative_std.argmax())
    assert found.steps[1].dropped == training.parameters.labels[worst]
    assert found.steps[1].relative_std == pytest.approx(full.relative_std[worst])
    training_errors = [step.training_error for step in found.steps]
    assert (np.diff(training_errors) >= 0).all()


def test_each_step_is_a_weighted_fit_of_its_own():
    training, validation = make_data()
    found, weights = eliminate_parameters(training, validation), quiet_fit(training).weights
    for step in found.steps:
        columns = [training.parameters.labels.index(label) for label in step.labels]
        X = (training.regressor * weights[:, None])[:, :, columns].reshape(-1, len(columns))
        expected = np.linalg.lstsq(X, (training.force * weights).ravel())[0]
        np.testing.assert_allclose(step.values[columns], expected, rtol=1e-7)
        residual = validation.residual(step.values)
        scale = quiet_fit(training).noise.deviation
        assert step.error.mean == pytest.approx(np.mean((residual / scale) ** 2))


def test_standard_errors_of_steps_are_those_of_the_full_error_model():
    training, validation = make_data()
    full, found = quiet_fit(training), eliminate_parameters(training, validation)
    gone = training.parameters.labels.index(found.steps[1].dropped)
    left = [j for j in range(6) if j != gone]
    X = (training.regressor * full.weights[:, None]).reshape(-1, 6)
    meat = X.T @ X @ full.covariance @ X.T @ X
    inverse = np.linalg.inv(X[:, left].T @ X[:, left])
    spread = np.sqrt(np.diag(inverse @ meat[np.ix_(left, left)] @ inverse))
    relative = 100 * spread / np.abs(found.steps[1].values[left])
    assert found.steps[2].relative_std == pytest.approx(relative.max())


def test_the_fewest_that_are_not_clearly_worse_are_chosen():
    found = eliminate_parameters(*make_data(1))
    errors = np.array([step.error.mean for step in found.steps])
    best = found.steps[int(errors.argmin())]
    fewer = [s for s in found.steps if len(s.labels) < len(found.chosen.labels)]
    assert best.error.excess_error == 0
    allowed = {
        id(step): max(
            min(best.error.standard_error, 2 * step.error.excess_error), 0.02 * best.error.mean
        )
        for step in found.steps
    }
    above = {id(step): step.error.mean - best.error.mean for step in found.steps}
    assert above[id(found.chosen)] <= allowed[id(found.chosen)]
    assert all(above[id(step)] > allowed[id(step)] for step in fewer)


def test_what_no_step_explains_does_not_count_as_uncertainty():
    training, validation = make_data(1)
    found = eliminate_parameters(training, validation)
    # A disturbance of the validation data that is far from all regressors.
    rough = np.where(np.arange(len(validation)) % 2, 1.0, -1.0)[:, None] * 3
    spoilt = eliminate_parameters(training, validation.with_force(validation.force + rough))
    assert spoilt.chosen.error.standard_error > found.chosen.error.standard_error
    assert spoilt.chosen.labels == found.chosen.labels


def test_dropped_parameters_go_back_to_their_reference():
    start = np.array([1.0, 2.0, -3.0, 4.0, -5.0, 6.0])
    training, validation = make_data(3, start)
    found = eliminate_parameters(training, validation, reference=start)
    plain = eliminate_parameters(*make_data(3))
    assert found.result.parameters == plain.result.parameters
    np.testing.assert_allclose(found.fit.values, plain.fit.values + start, rtol=1e-9)
    np.testing.assert_allclose(found.fit.covariance, plain.fit.covariance, rtol=1e-8)
    dropped = [j for j in range(6) if j not in found.columns]
    np.testing.assert_array_equal(found.fit.values[dropped], start[dropped])
    assert not found.fit.covariance[dropped].any()
    for step, other in zip(found.steps, plain.steps, strict=True):
        assert step.error.mean == pytest.approx(other.error.mean)


def test_the_result_is_the_fit_of_the_supported_parameters():
    training, validation = make_data()
    found = eliminate_parameters(training, validation, estimator="ols")
    assert found.result == quiet_fit(training.select(found.columns), "ols")
    assert found.result.parameters.labels == found.chosen.labels


def test_an_actuator_without_training_samples_does_not_count():
    training, validation = make_data()
    used = training.used & [True, False]
    half = named_samples(training.regressor, training.force, used, training.segments)
    found = eliminate_parameters(half, validation)
    alone = eliminate_parameters(*(first_actuator(data) for data in (training, validation)))
    assert found.chosen.labels == alone.chosen.labels
    for step, other in zip(found.steps, alone.steps, strict=True):
        assert step.error.mean == pytest.approx(other.error.mean)
        assert step.training_error == pytest.approx(other.training_error)


def first_actuator(data):
    return named_samples(data.regressor[:, :1], data.force[:, :1], None, data.segments)


def test_what_cannot_be_reduced_is_refused():
    training, validation = make_data()
    with pytest.raises(DataError, match="validation data must have"):
        eliminate_parameters(training, validation.select(range(5)))
    with pytest.raises(DataError, match=r"reference must have shape \(6,\)"):
        eliminate_parameters(training, validation, reference=np.zeros(5))
    exact = training.with_force(training.regressor @ TRUTH)
    with pytest.raises(DataError, match="without error"):
        eliminate_parameters(exact, validation, estimator="ols")
    unused = named_samples(
        validation.regressor, validation.force, np.zeros(validation.force.shape, dtype=bool)
    )
    with pytest.raises(DataError, match="no validation sample"):
        eliminate_parameters(training, unused)


def test_outliers_count_as_little_in_subsets():
    def made(seed):
        rng = np.random.default_rng(seed)
        W = rng.normal(size=(400, 2, 5))
        errors = rng.normal(size=(400, 2)) + np.abs(outliers(rng, (400, 2), size=40.0))
        return named_samples(W, W @ truth + errors)

    truth = np.array([5.0, -2.0, 3.0, 0.0, 0.0])
    found, plain = (
        eliminate_parameters(made(1), made(2), estimator=name) for name in ("bisquare", "wls")
    )
    full = quiet_fit(made(1), "bisquare")
    np.testing.assert_allclose(found.steps[0].values, full.values, rtol=1e-6, atol=1e-8)
    assert set(found.steps[2].labels) == {"link0.m", "link1.m", "link2.m"}
    errors = [np.abs(each.steps[2].values - truth).max() for each in (found, plain)]
    assert errors[0] < 0.5 * errors[1]


def test_the_size_of_blocks_does_not_count(set_block_rows):
    whole = eliminate_parameters(*make_data(2))
    set_block_rows(33)
    blocked = eliminate_parameters(*make_data(2))
    for one, other in zip(whole.steps, blocked.steps, strict=True):
        assert one.labels == other.labels
        assert one.error[:4] == pytest.approx(other.error[:4], rel=1e-7, abs=1e-9)


VALUES = np.array([3.0, -1.0, 5.0, 10.0, 2.0, -4.0])
NAMES = ["link4.m", "link0.m", "link3.m"]


def noisy(seed=0):
    W, rng = smooth_regressor(seed, 120), np.random.default_rng(seed)
    return named_samples(W, W @ VALUES + rng.normal(size=(120, 2)))


def test_influence_is_equation_12():
    samples = noisy()
    W = samples.regressor.reshape(-1, 6)
    force = samples.force.ravel()
    norm = np.linalg.norm
    expected = [100 * norm(W[:, :i] @ VALUES[:i]) / norm(force) for i in range(1, 7)]
    np.testing.assert_allclose(influence(samples, VALUES), expected)


def test_influence_need_not_grow_and_may_exceed_all():
    W = np.ones((10, 1, 2))
    samples = named_samples(W, np.ones((10, 1)))
    np.testing.assert_allclose(influence(samples, np.array([3.0, -2.0])), [300.0, 100.0])


def test_influence_of_nothing_is_refused():
    samples = noisy()
    with pytest.raises(DataError, match="measured forces are all zero"):
        influence(samples.with_force(0 * samples.force), VALUES)
    with pytest.raises(DataError, match="values"):
        influence(samples, VALUES[:3])


@given(st.integers(0, 1000), st.integers(1, 6))
def test_a_noiseless_fit_of_some_parameters_gives_the_truncated_values(seed, count):
    W = smooth_regressor(seed, 60)
    samples = named_samples(W, W @ VALUES)
    found = OrdinaryLeastSquares().fit(samples.select(range(count)).problem)
    expected = truncated_values(samples, VALUES, count)
    np.testing.assert_allclose(found.values, expected, rtol=1e-6, atol=1e-6)
