"""Estimators by name, two experiments one after the other, examples and summaries."""

import doctest
from importlib import import_module

import numpy as np
import pytest

from loopid.errors import OptionError, RankError
from loopid.identification import (
    BayesianRidge,
    Bisquare,
    FitSamples,
    OrdinaryLeastSquares,
    Prior,
    TotalLeastSquares,
    WeightedLeastSquares,
    eliminate,
    fit,
    fit_in_steps,
    quiet_fit,
    working_fit,
)
from loopid.parameters import ParameterSet
from smooth_data import assert_coverage, covered, named_samples, runs, smooth_regressor

TRUTH = np.array([3.0, -1.0, 5.0, 10.0, 2.0, -4.0])
KNOWN = ("link4.m", "link1.m")
DEVIATIONS = np.array([0.5, 1.0])


def experiments(seed):
    """Friction-like parameters in a short first experiment of their own, and all in a second."""
    first, second = smooth_regressor(1, 100)[:, :, [1, 4]], smooth_regressor(2, 150)
    # The second experiment alone would hardly excite the known ones.
    second[:, :, 1] = 0.05 * second[:, :, 1] + second[:, :, 0] + second[:, :, 2]
    second[:, :, 4] = 0.05 * second[:, :, 4] + second[:, :, 3] - second[:, :, 5]
    rng = np.random.default_rng(seed)
    errors = [rng.normal(size=(len(W), 2)) * DEVIATIONS for W in (first, second)]
    force = first @ TRUTH[[1, 4]] + 3 * errors[0]
    names = ParameterSet.from_labels(["link1.m", "link4.m"])
    one = FitSamples.of(names, ("a", "b"), first, force)
    return one, named_samples(second, second @ TRUTH + errors[1])


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


def test_the_joint_covariance_is_the_textbooks():
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


@runs(30, 300)
@pytest.mark.filterwarnings("ignore::loopid.errors.CorrelationWarning")
def test_intervals_cover_only_with_the_uncertainty_of_the_first_step(runs):
    rates, alone, errors, stated, free = [], [], [], [], [0, 2, 3, 5]
    for seed in range(runs):
        first, second = experiments(seed)
        found, row = fit_in_steps(first, second, KNOWN), second.regressor[17, 0]
        rates.append(covered(found, TRUTH))
        alone.append(covered(dense_rest(first, second)[1], TRUTH[free]))
        errors.append(row @ (found.values - TRUTH))
        stated.append(row @ found.covariance @ row)
    assert_coverage(rates, slack=0.005)
    assert np.mean(alone) < 0.8
    # A variance from so many draws; predictions have the joint uncertainty.
    assert np.mean(np.square(errors)) == pytest.approx(np.mean(stated), rel=4.5 / np.sqrt(runs))


def test_one_experiment_twice_gives_the_joint_fit():
    # Exact for independent errors and equal weights: one actuator.
    W, rng = smooth_regressor(0, 200, dof=1), np.random.default_rng(0)
    samples = named_samples(W, W @ TRUTH + rng.normal(size=(200, 1)))
    joint = WeightedLeastSquares().fit(samples.problem)
    found = fit_in_steps(samples, samples, KNOWN)
    np.testing.assert_allclose(found.values, joint.values, rtol=1e-8)
    # The second step does not know that it has fitted the known ones to the same data: its variance
    # is over 196 instead of 194.
    np.testing.assert_allclose(found.covariance, joint.covariance, rtol=0.02, atol=1e-6)


def test_parameters_that_no_step_determines_are_refused():
    first, second = experiments(0)
    with pytest.raises(OptionError, match=r"second step 'link9\.m': choose one of link0\.m"):
        fit_in_steps(first, second, ["link9.m"])
    with pytest.raises(OptionError, match=r"first step 'link0\.m': choose one of link1\.m, link4"):
        fit_in_steps(first, second, ["link0.m"])
    with pytest.raises(OptionError, match="nothing is left"):
        fit_in_steps(second, first, ["link1.m", "link4.m"])
    silent = first.regressor * [1, 0]
    blind = type(first).of(first.parameters, first.actuators, silent, first.force)
    with pytest.raises(RankError, match=r"link4\.m"):
        fit_in_steps(blind, second, KNOWN)


def noisy(seed=0):
    W = smooth_regressor(seed, 200)
    return named_samples(W, W @ TRUTH + np.random.default_rng(seed).normal(size=(200, 2)))


def test_estimators_are_chosen_by_name_or_given():
    assert fit(noisy(), OrdinaryLeastSquares()) == fit(noisy(), "ols")
    assert fit(noisy()).estimator == "wls"
    with pytest.raises(
        OptionError, match="unknown estimator 'lms': choose one of ols, wls, huber, b"
    ):
        fit(noisy(), "lms")


@pytest.mark.parametrize(
    "module",
    [
        "fitting",
        "least_squares",
        "robust",
        "bayes",
        "total_least_squares",
        "instrumental",
        "selection",
        "result",
    ],
)
def test_examples_run(module):
    failed, _ = doctest.testmod(import_module(f"loopid.identification.{module}"))
    assert failed == 0


def test_summaries_fit_in_ten_lines():
    many = smooth_regressor(0, 600, dof=4, count=20, harmonics=12)
    noise = np.random.default_rng(0).normal(size=(600, 4))
    samples = named_samples(many, many @ np.arange(20) + noise)
    prior = Prior.independent(samples.parameters, np.zeros(20), np.ones(20))
    found, working = quiet_fit(samples), working_fit(samples, "bisquare")
    reduction = eliminate(samples, samples)
    for shown in (
        *(samples, samples.problem, found, found.quality, found.noise, working),
        *(working.result.robustness, prior, BayesianRidge(prior, np.ones(4)), Bisquare()),
        *(TotalLeastSquares(np.ones(20)), reduction, reduction.steps[0]),
    ):
        lines = repr(shown).splitlines()
        assert len(lines) <= 10
        assert max(map(len, lines)) < 200
        assert type(shown).__name__ in lines[0]
    assert "20 parameters" in repr(found)
    assert "13 more" in repr(found)
    for table, rows in ((found, 20), (reduction, len(reduction.steps))):
        html = table._repr_html_()
        assert html.count("<tr>") == rows + 1
        assert "link19.m" in html
