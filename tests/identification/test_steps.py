"""Two experiments, one after the other."""

import numpy as np
import pytest

from loopid.errors import OptionError, RankError
from loopid.identification import WeightedLeastSquares, fit_in_steps
from loopid.identification import quiet_fit

TRUTH = np.array([3.0, -1.0, 5.0, 10.0, 2.0, -4.0])
KNOWN = ("link4.m", "link1.m")
DEVIATIONS = np.array([0.5, 1.0])


@pytest.fixture
def experiments(make_regressor, make_samples):
    """Friction-like parameters in a short first experiment of their own, and all in a second."""
    first, second = make_regressor(1, 100), make_regressor(2, 150)
    # The second experiment alone would hardly tell the known ones from the others.
    second[:, :, 1] = 0.05 * second[:, :, 1] + second[:, :, 0] + second[:, :, 2]
    second[:, :, 4] = 0.05 * second[:, :, 4] + second[:, :, 3] - second[:, :, 5]

    def make(seed, scale=1.0):
        rng = np.random.default_rng(seed)
        errors = [scale * rng.normal(size=(len(W), 2)) * DEVIATIONS for W in (first, second)]
        alone = first[:, :, [1, 4]]
        one = make_samples(alone, alone @ TRUTH[[1, 4]] + 3 * errors[0])
        names = one.parameters.from_labels(["link1.m", "link4.m"])
        one = type(one).of(names, one.actuators, alone, one.force)
        return one, make_samples(second, second @ TRUTH + errors[1])

    return make


def dense_rest(first, second):
    """Values and covariance of the second step, from stacked matrices."""
    start = quiet_fit(first)
    held, free = [1, 4], [0, 2, 3, 5]
    W = second.regressor
    left = second.with_force(second.force - W[:, :, held] @ start.values).select(free)
    rest = quiet_fit(left)
    X = (W * rest.weights[:, None]).reshape(-1, 6)
    H = np.linalg.inv(X[:, free].T @ X[:, free]) @ X[:, free].T @ X[:, held]
    return start, rest, H


def test_the_joint_covariance_is_the_textbooks(experiments):
    first, second = experiments(0)
    found = fit_in_steps(first, second, KNOWN)
    start, rest, H = dense_rest(first, second)
    held, free = [1, 4], [0, 2, 3, 5]
    assert found.parameters == second.parameters
    np.testing.assert_allclose(found.values[held], start.values)
    np.testing.assert_allclose(found.values[free], rest.values)
    spread = start.covariance
    expected = rest.covariance + H @ spread @ H.T
    np.testing.assert_allclose(found.covariance[np.ix_(held, held)], spread)
    np.testing.assert_allclose(found.covariance[np.ix_(free, free)], expected, rtol=1e-7)
    np.testing.assert_allclose(found.covariance[np.ix_(free, held)], -H @ spread, rtol=1e-7)
    assert found.degrees_of_freedom == start.degrees_of_freedom
    residual = second.force - found.predict(second.regressor)
    np.testing.assert_allclose(found.quality.residual_rms, np.sqrt((residual**2).mean(axis=0)))


@pytest.mark.filterwarnings("ignore::loopid.errors.CorrelationWarning")
def test_intervals_cover_only_with_the_uncertainty_of_the_first_step(experiments):
    covered, alone = [], []
    for seed in range(300):
        first, second = experiments(seed)
        found = fit_in_steps(first, second, KNOWN)
        low, high = found.intervals().T
        covered.append((low <= TRUTH) & (high >= TRUTH))
        _, rest, _ = dense_rest(first, second)
        low, high = rest.intervals().T
        free = TRUTH[[0, 2, 3, 5]]
        alone.append((low <= free) & (free <= high))
    each = np.mean(covered, axis=0)
    assert (each > 0.91).all()
    assert 0.93 < each.mean() < 0.97
    assert np.mean(alone) < 0.8


@pytest.mark.filterwarnings("ignore::loopid.errors.CorrelationWarning")
def test_predictions_have_the_joint_uncertainty(experiments):
    _, second = experiments(0)
    row, errors, stated = second.regressor[17, 0], [], []
    for seed in range(300):
        found = fit_in_steps(*experiments(seed), KNOWN)
        errors.append(row @ (found.values - TRUTH))
        stated.append(row @ found.covariance @ row)
    assert np.var(errors) == pytest.approx(np.mean(stated), rel=0.25)


def test_one_experiment_twice_gives_the_joint_fit(make_regressor, make_samples):
    # Exact for independent errors and equal weights: one actuator.
    W, rng = make_regressor(0, 200, dof=1), np.random.default_rng(0)
    samples = make_samples(W, W @ TRUTH + rng.normal(size=(200, 1)))
    joint = WeightedLeastSquares().fit(samples.problem)
    found = fit_in_steps(samples, samples, KNOWN)
    np.testing.assert_allclose(found.values, joint.values, rtol=1e-8)
    # The second step does not know that it has fitted the known ones to the same data: its variance
    # is over 196 instead of 194.
    np.testing.assert_allclose(found.covariance, joint.covariance, rtol=0.02, atol=1e-6)


def test_parameters_that_no_step_tells_are_refused(experiments):
    first, second = experiments(0)
    with pytest.raises(OptionError, match=r"second step 'link9\.m': choose one of link0\.m"):
        fit_in_steps(first, second, ["link9.m"])
    with pytest.raises(OptionError, match=r"first step 'link0\.m': choose one of link1\.m, link4"):
        fit_in_steps(first, second, ["link0.m"])
    with pytest.raises(OptionError, match="nothing is left"):
        fit_in_steps(second, first, ["link1.m", "link4.m"])
    silent = first.regressor * [1, 0]
    dark = type(first).of(first.parameters, first.actuators, silent, first.force)
    with pytest.raises(RankError, match=r"link4\.m"):
        fit_in_steps(dark, second, KNOWN)
