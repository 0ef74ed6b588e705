"""Fits of logs that do not show everything: refused, or the robot file stands in and is named."""

import warnings

import numpy as np
import pytest
from test_identifiability import one_joint

from loopid import JointTerms
from loopid.errors import ExcitationWarning, OptionError, RankError
from loopid.experiment import cad_prior, data_support, find_force_model, identify
from loopid.experiment.excited import Excited
from loopid.experiment.supported_fit import fit_supported
from loopid.identification import BayesianRidge, fit, quiet_fit
from loopid.saved import read_fit, save_fit
from made_runs import modelled, wander

DRAWS = 100


def quietly(function, *arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return function(*arguments, **options)


@pytest.fixture(scope="module")
def model(load_once):
    robot = load_once("five_bar")
    return find_force_model(robot, "full", JointTerms(robot.actuated))


@pytest.fixture(scope="module")
def truth(model):
    """Not quite the robot file, and friction."""
    generator = np.random.default_rng(3)
    values = model.prior * (1 + 0.05 * generator.normal(size=len(model.prior)))
    values[model.joint_columns] = (2.0, 1.0, 3.0, 0.5)
    return values


@pytest.fixture(scope="module")
def runs(model):
    """One joint moves; both do, to validate."""
    robot = model.mechanism
    return one_joint(robot, 0, 0.4), wander(robot, 4, 8.0, 20.0, size=(0.4, 0.4))


@pytest.fixture(scope="module")
def data(model, truth, runs):
    return [[modelled(model, run, truth, noise=0.02, seed=k)] for k, run in enumerate(runs)]


def test_by_default_it_is_refused_by_name_and_with_the_motion_to_add(model, data):
    support = data_support(model, data[0])
    with pytest.raises(RankError) as refused:
        quietly(identify, model, *data)
    said = str(refused.value)
    assert said.startswith(f"the data do not show {len(support.dark)} of 15 combinations")
    for direction in support.dark[:3]:
        assert f"{direction.text} (lit by {direction.lighting.text})" in said
    assert "on_dark='truncate'" in said


@pytest.mark.parametrize("estimator", ["wls", "ols", "huber", "bisquare"])
def test_truncated_fits_are_as_good_as_any_and_nearest_to_the_robot_file(model, data, estimator):
    samples = model.samples(data[0][0])
    excited = Excited.of(model, samples.problem)
    found = fit_supported(samples, model.prior, excited, estimator)
    # Nothing is gained from the directions that are dark ...
    moved = found.values + excited.dark @ np.ones(excited.dark.shape[1])
    squares = samples.problem.residual_squares
    np.testing.assert_allclose(squares(moved), squares(found.values), rtol=1e-6)
    # ... along which the robot file stands.
    x = np.linalg.solve(excited.factor, found.values - model.prior)
    dark = excited.directions[:, excited.rank :]
    np.testing.assert_allclose(dark.T @ x, 0, atol=1e-8)
    # There the uncertainty is that of the robot file: one size, whatever the rest is.
    inverse = np.linalg.inv(excited.factor)
    spread = dark.T @ inverse @ found.covariance @ inverse.T
    np.testing.assert_allclose(spread, dark.T, atol=1e-6)
    if estimator == "ols":
        W, tau = samples.regressor.reshape(-1, 15), samples.force.ravel()
        best = np.linalg.lstsq(W, tau, rcond=1e-10)[1:3]
        assert best[1] == excited.rank
        residual = tau - W @ found.values
        least = tau - W @ np.linalg.lstsq(W, tau, rcond=1e-10)[0]
        assert residual @ residual == pytest.approx(least @ least, rel=1e-6)


def test_where_all_is_shown_nothing_is_truncated(model, data):
    samples = model.samples(data[1][0])
    excited = Excited.of(model, samples.problem)
    found, plain = fit_supported(samples, model.prior, excited), quiet_fit(samples)
    assert excited.rank == 15
    np.testing.assert_allclose(found.values, plain.values, rtol=1e-5)
    np.testing.assert_allclose(found.standard_errors, plain.standard_errors, rtol=1e-5)
    assert found.assumed == ()


def test_what_rests_on_the_robot_file_has_no_interval_and_the_rest_holds(model, runs, truth):
    # The robot file is wrong along what is dark: only what is assumed may miss the truth by it.
    held = np.zeros(15)
    for seed in range(DRAWS):
        samples = model.samples(modelled(model, runs[0], truth, noise=0.02, seed=seed))
        excited = Excited.of(model, samples.problem)
        found = fit_supported(samples, model.prior, excited)
        low, high = found.intervals().T
        held += (low <= truth) & (truth <= high)
    assumed = np.isin(model.parameters.labels, found.assumed)
    assert 0 < assumed.sum() < 15
    assert np.isinf(low[assumed]).all()
    assert np.isinf(high[assumed]).all()
    assert np.isfinite(low[~assumed]).all()
    assert (held[~assumed] > 0.87 * DRAWS).all()
    assert held[~assumed].mean() < 0.99 * DRAWS


def test_an_identification_says_what_it_took_from_the_robot_file(model, data, tmp_path):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = identify(model, *data, on_dark="truncate")
    said = [str(warning.message) for warning in caught if warning.category is ExcitationWarning]
    assert found.support.darkness in said
    assert found.fit.assumed == found.support.assumed
    assert set(found.fit.assumed) <= set(found.fit.unsupported())
    assert "right_crank_joint.Fc" in found.fit.assumed
    assert read_fit(save_fit(tmp_path / "fit.yaml", model, found.fit)).result == found.fit
    assert found.candidates[1].fitted == found.support.rank
    # What data do not show is not among the corrections that they support.
    labels = found.reduction.result.parameters.labels
    assert not {"right_crank_joint.Fc", "right_crank_joint.Fv"} & set(labels)
    assert len(found.reduction.steps[0].labels) == found.support.rank
    kept = [j for j, name in enumerate(model.parameters.labels) if name not in labels]
    np.testing.assert_array_equal(found.supported.values[kept], model.prior[kept])
    assert all(len(step.values) == 15 for step in found.reduction.steps)


def test_a_prior_needs_no_truncation_but_is_not_silent_either(model, data):
    bodies = [name for name in model.parameters.labels if not name.endswith((".Fc", ".Fv"))]
    with pytest.raises(RankError, match="on_dark"):  # nothing is known of friction
        quietly(identify, model, *data, "bayes")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = identify(model, *data, "bayes", on_dark="truncate")
    assert any(found.support.darkness == str(warning.message) for warning in caught)
    prior = cad_prior(model).deviations[[model.parameters.labels.index(name) for name in bodies]]
    errors = found.fit.standard_errors[[model.parameters.labels.index(name) for name in bodies]]
    assert (errors <= 1.01 * prior).all()
    assert found.fit.assumed == found.support.assumed


def test_a_prior_of_ever_less_certainty_is_truncation(model, data):
    samples = model.samples(data[0][0])
    excited = Excited.of(model, samples.problem)
    truncated = fit_supported(samples, model.prior, excited).values
    prior = cad_prior(model, 1.0, joint_deviations=excited.joint_sizes)
    off = []
    for scale in (1e2, 1e4):
        loose = type(prior)(prior.parameters, prior.values, scale**2 * prior.covariance)
        values = fit_values(samples, loose)
        off.append(np.abs((values - truncated) / np.linalg.norm(excited.factor, axis=1)).max())
    assert off[1] < 0.1 * off[0]
    assert off[1] < 1e-3


def fit_values(samples, prior):
    return quietly(quiet_fit, samples, BayesianRidge(prior)).values


def test_the_width_of_the_prior_is_an_option(model, data):
    found = [
        quietly(identify, model, data[1], data[1], "bayes", prior_deviation=part)
        for part in (1e-4, 10.0)
    ]
    plain = quietly(identify, model, data[1], data[1])
    bodies = model.body_columns
    sizes = np.linalg.norm(plain.support.excited.factor, axis=1)[bodies]
    off = np.abs(found[0].fit.values - model.prior)[bodies] / sizes
    assert off.max() < 1e-3
    loose = np.abs(found[1].fit.values - plain.fit.values) / plain.fit.standard_errors
    assert loose.max() < 0.2
    for estimator in ("wls", "huber"):
        with pytest.raises(OptionError, match="'bayes'"):
            quietly(identify, model, *data, estimator, prior_deviation=0.1, on_dark="truncate")


def test_instruments_come_from_a_reference_motion(model, runs, truth, data):
    recordings, fresh = data[1], [modelled(model, runs[1], truth, noise=0.02, seed=9)]
    found = quietly(identify, model, recordings, fresh, "iv", references=[runs[1]])
    plain = quietly(identify, model, recordings, fresh)
    # The reference is the motion itself: nothing changes.
    np.testing.assert_allclose(found.fit.values, plain.fit.values, rtol=1e-6)
    assert found.fit.estimator == "iv"
    for estimator, references in (("iv", []), ("wls", [runs[1]]), ("iv", [runs[1]] * 2)):
        with pytest.raises(OptionError, match="reference motions"):
            quietly(identify, model, recordings, fresh, estimator, references=references)


def test_friction_from_its_own_log_needs_a_log_that_shows_it(model, data):
    with pytest.raises(RankError, match="the data do not show"):
        quietly(identify, model, data[1], data[1], friction=data[0])
    with pytest.raises(RankError, match="the data do not show"):
        quietly(identify, model, data[0], data[1], friction=data[1], on_dark="truncate")
    found = quietly(identify, model, data[1], data[1], friction=data[1])
    assert found.support.parameters.labels == tuple(
        model.parameters.labels[j] for j in model.body_columns
    )


def test_unknown_answers_are_refused(model, data):
    with pytest.raises(OptionError, match=r"'ignore'.*refuse, truncate"):
        quietly(identify, model, *data, on_dark="ignore")


def test_bodies_that_can_exist_are_fitted_on_demand(model, data):
    pytest.importorskip("cvxpy")
    found = quietly(identify, model, data[1], data[1], consistent="entropic")
    bodies = found.consistent
    assert bodies.regularisation == "entropic"
    np.testing.assert_allclose(
        model.base.values(bodies.standard_parameters), bodies.values, rtol=1e-9, atol=1e-12
    )
    assert bodies.fit_cost.total < 1.02
    assert (bodies.margins > 0).all()
    assert quietly(identify, model, data[1], data[1]).consistent is None


def test_a_fit_of_samples_alone_still_refuses(model, data):
    with pytest.raises(RankError, match=r"do not show right_crank\.Izz"):
        quietly(fit, model.samples(data[0][0]))
