"""Backward elimination: it keeps what matters, and drops what does not."""

import numpy as np
import pytest

from loopid.errors import DataError, OptionError
from loopid.identification import WeightedLeastSquares
from loopid.identification import quiet_fit
from loopid.identification import eliminate

TRUTH = np.array([3.0, 0.0, 5.0, 0.0, 0.0, -4.0])
REAL = ("link0.m", "link2.m", "link5.m")
DEVIATIONS = np.array([0.5, 4.0])


@pytest.fixture(scope="module")
def make_data(make_regressor, make_errors, make_samples):
    """Training and validation samples; the parameters' distance from a start is TRUTH."""

    def make(seed=0, start=0.0, coefficient=0.8):
        rng, data = np.random.default_rng(seed), []
        for k, count in enumerate((800, 600)):
            W = make_regressor(10 + k, count)
            force = W @ (TRUTH + start)
            force += make_errors(rng, force.shape, coefficient) * DEVIATIONS
            data.append(make_samples(W, force, None, np.arange(count) // 200))
        return tuple(data)

    return make


def test_the_parameters_that_matter_are_kept(make_data):
    kept, counts = np.zeros(6), []
    for seed in range(40):
        found = eliminate(*make_data(seed))
        kept[list(found.columns)] += 1
        counts.append(found.supported)
    assert (kept[[0, 2, 5]] == 40).all()
    assert np.mean(counts) < 3.5


def test_steps_go_from_all_to_one_by_the_least_certain(make_data):
    training, validation = make_data()
    found = eliminate(training, validation)
    full = quiet_fit(training)
    assert [len(step.labels) for step in found.steps] == [6, 5, 4, 3, 2, 1]
    assert found.steps[0].dropped is None
    np.testing.assert_allclose(found.steps[0].values, full.values, rtol=1e-9)
    worst = int(full.relative_std.argmax())
    assert found.steps[1].dropped == training.parameters.labels[worst]
    assert found.steps[1].relative_std == pytest.approx(full.relative_std[worst])
    training_errors = [step.training_error for step in found.steps]
    assert (np.diff(training_errors) >= 0).all()


def test_each_step_is_a_weighted_fit_of_its_own(make_data):
    training, validation = make_data()
    found, weights = eliminate(training, validation), quiet_fit(training).weights
    for step in found.steps:
        columns = [training.parameters.labels.index(label) for label in step.labels]
        X = (training.regressor * weights[:, None])[:, :, columns].reshape(-1, len(columns))
        expected = np.linalg.lstsq(X, (training.force * weights).ravel())[0]
        np.testing.assert_allclose(step.values[columns], expected, rtol=1e-7)
        residual = validation.residual(step.values)
        np.testing.assert_allclose(step.validation_rms, np.sqrt((residual**2).mean(axis=0)))
        scale = quiet_fit(training).noise.deviation
        assert step.validation_error == pytest.approx(np.mean((residual / scale) ** 2))


def test_standard_errors_of_steps_are_those_of_the_full_error_model(make_data):
    training, validation = make_data()
    full, found = quiet_fit(training), eliminate(training, validation)
    gone = training.parameters.labels.index(found.steps[1].dropped)
    left = [j for j in range(6) if j != gone]
    X = (training.regressor * full.weights[:, None]).reshape(-1, 6)
    meat = X.T @ X @ full.covariance @ X.T @ X
    inverse = np.linalg.inv(X[:, left].T @ X[:, left])
    spread = np.sqrt(np.diag(inverse @ meat[np.ix_(left, left)] @ inverse))
    relative = 100 * spread / np.abs(found.steps[1].values[left])
    assert found.steps[2].relative_std == pytest.approx(relative.max())


def test_the_fewest_that_are_not_clearly_worse_are_chosen(make_data):
    found = eliminate(*make_data(1))
    errors = np.array([step.validation_error for step in found.steps])
    best = found.steps[int(errors.argmin())]
    fewer = [s for s in found.steps if len(s.labels) < len(found.chosen.labels)]
    assert (best.excess, best.excess_error) == (0, 0)
    for step in found.steps:
        assert step.excess == pytest.approx(step.validation_error - best.validation_error)
    allowed = {
        id(step): max(min(best.standard_error, 2 * step.excess_error), 0.02 * best.validation_error)
        for step in found.steps
    }
    assert found.chosen.excess <= allowed[id(found.chosen)]
    assert all(step.excess > allowed[id(step)] for step in fewer)


def test_what_no_step_explains_does_not_count_as_doubt(make_data):
    training, validation = make_data(1)
    found = eliminate(training, validation)
    # A disturbance of the validation data that is far from all regressors.
    rough = np.where(np.arange(len(validation)) % 2, 1.0, -1.0)[:, None] * 3
    spoilt = eliminate(training, validation.with_force(validation.force + rough))
    assert spoilt.chosen.standard_error > found.chosen.standard_error
    assert spoilt.chosen.labels == found.chosen.labels


def test_the_standard_error_is_the_spread_of_the_validation_error(make_data):
    runs = [eliminate(*make_data(seed)).steps[3] for seed in range(60)]
    spread = np.std([step.validation_error for step in runs])
    stated = np.sqrt(np.mean([step.standard_error**2 for step in runs]))
    assert stated == pytest.approx(spread, rel=0.35)


def test_dropped_parameters_go_back_to_their_reference(make_data):
    start = np.array([1.0, 2.0, -3.0, 4.0, -5.0, 6.0])
    training, validation = make_data(3, start)
    found = eliminate(training, validation, reference=start)
    plain = eliminate(*make_data(3))
    assert found.result.parameters == plain.result.parameters
    np.testing.assert_allclose(found.values, plain.values + start, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, plain.covariance, rtol=1e-8)
    dropped = [j for j in range(6) if j not in found.columns]
    np.testing.assert_array_equal(found.values[dropped], start[dropped])
    assert not found.covariance[dropped].any()
    for step, other in zip(found.steps, plain.steps, strict=True):
        assert step.validation_error == pytest.approx(other.validation_error)


def test_the_result_is_the_fit_of_the_supported_parameters(make_data):
    training, validation = make_data()
    found = eliminate(training, validation, "ols")
    assert found.result == quiet_fit(training.select(found.columns), "ols")
    assert found.supported == len(found.chosen.labels)


def test_kept_parameters_are_never_dropped(make_data):
    found = eliminate(*make_data(), keep=["link1.m", "link4.m"])
    assert {"link1.m", "link4.m"} <= set(found.chosen.labels)
    assert set(found.steps[-1].labels) == {"link1.m", "link4.m"}
    everything = make_data()[0].parameters.labels
    assert len(eliminate(*make_data(), keep=everything).steps) == 1


def test_an_actuator_without_training_samples_does_not_count(make_data, make_samples):
    training, validation = make_data()
    used = training.used & [True, False]
    half = make_samples(training.regressor, training.force, used, training.stretches)
    found = eliminate(half, validation)
    alone = eliminate(*(first_actuator(data, make_samples) for data in (training, validation)))
    assert found.chosen.labels == alone.chosen.labels
    for step, other in zip(found.steps, alone.steps, strict=True):
        assert step.validation_error == pytest.approx(other.validation_error)
        assert step.training_error == pytest.approx(other.training_error)


def first_actuator(data, make_samples):
    return make_samples(data.regressor[:, :1], data.force[:, :1], None, data.stretches)


def test_what_cannot_be_reduced_is_refused(make_data, make_samples):
    training, validation = make_data()
    with pytest.raises(DataError, match="validation data must have"):
        eliminate(training, validation.select(range(5)))
    with pytest.raises(DataError, match=r"reference must have shape \(6,\)"):
        eliminate(training, validation, reference=np.zeros(5))
    with pytest.raises(OptionError, match=r"to keep 'link9\.m'"):
        eliminate(training, validation, keep=["link9.m"])
    exact = training.with_force(training.regressor @ TRUTH)
    with pytest.raises(DataError, match="without error"):
        eliminate(exact, validation, "ols")
    unused = make_samples(
        validation.regressor, validation.force, np.zeros(validation.force.shape, dtype=bool)
    )
    with pytest.raises(DataError, match="no validation sample"):
        eliminate(training, unused)


def test_an_estimator_may_be_given(make_data):
    training, validation = make_data()
    by_name = eliminate(training, validation, "wls")
    given = eliminate(training, validation, WeightedLeastSquares())
    assert by_name.result == given.result
