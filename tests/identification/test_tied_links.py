"""Links made alike share their parameters: fewer of them, surer ones, and the same forces."""

import re
from functools import cache

import numpy as np
import pytest
from test_force_model import random_motion

import loopid
from bank_robots import few_of
from loopid.base_parameters import find_base
from loopid.errors import ModelWarning
from loopid.identification import WeightedLeastSquares, eliminate, identify
from loopid.identification.fitting import quiet_fit
from loopid.identification.prediction import prediction_reach
from loopid.identification.selection import judge_essential
from loopid.observation import Observation
from loopid.regressors import structural_observation
from made_runs import changed, modelled, quietly, record, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "none_missing")

# Of the 6UPS at rest, as nothing fast is in its motion.
CASES = {"3rrr": ("full", 0.3), "6ups": ("gravity", 0.04)}
DRAWS = 16


@cache
def model_of(name, tied):
    return loopid.force_model(loopid.load(name, tied=tied), CASES[name][0], None)


@pytest.fixture(scope="module", params=few_of(CASES, "3rrr"))
def case(request):
    """A robot's name, its force models untied and tied, and motions to fit and for later."""
    untied, tied = (model_of(request.param, kind) for kind in (False, True))
    size = [CASES[request.param][1]] * len(untied.robot.actuated)
    motions = [wander(untied.robot, seed, 30.0, size=size) for seed in (1, 2)]
    return request.param, untied, tied, motions


def summed(mechanism, labels, model):
    """Each label's sum of the columns that its group stands for, (n, m)."""
    group = {link: group.name for group in mechanism.identical for link in group.links}
    T = np.zeros((len(mechanism.parameters(model)), len(labels)))
    for k, parameter in enumerate(mechanism.parameters(model)):
        link, _, kind = parameter.label.rpartition(".")
        T[k, labels.index(f"{group.get(link, link)}.{kind}")] = 1
    return T


def test_parameters_are_named_by_their_groups(case):
    _, untied, tied, _ = case
    groups = tied.robot.identical
    named = {label.rpartition(".")[0] for label in tied.parameters.labels}
    assert {"platform"} < named <= {"platform", *(group.name for group in groups)}
    assert not any(link in " ".join(tied.base.expressions) for g in groups for link in g.links)
    assert len(tied.parameters) < len(untied.parameters)


def test_base_parameters_are_those_of_the_summed_columns(case):
    name, untied, tied, _ = case
    kind, samples = CASES[name][0], 100
    loose, shared = (
        structural_observation(model.robot, kind, samples=samples) for model in (untied, tied)
    )
    T = summed(untied.robot, shared.parameters.labels, kind)
    by_hand = Observation.from_matrix(loose.factor @ T, shared.parameters, length=loose.length)
    expected, found = (find_base(each) for each in (by_hand, shared))
    np.testing.assert_array_equal(found.base, expected.base)
    np.testing.assert_allclose(found.matrix, expected.matrix, atol=1e-9)
    assert len(found) <= len(find_base(loose))


def test_base_parameters_give_all_forces_of_any_shared_parameters(case):
    _, untied, tied, _ = case
    motion = random_motion(tied.robot, 25, seed=3)
    labels = tied.robot.parameters(tied.model).labels
    theta = np.random.default_rng(4).normal(size=len(labels))
    T = summed(untied.robot, list(labels), untied.model)
    expected = untied.regressor(motion) @ untied.base.values(T @ theta)
    found = tied.regressor(motion) @ tied.base.values(theta)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.fixture(scope="module")
def found(case):
    """Fits of all draws of the untied robot's forces, tied: errors in standard errors, hits."""
    _, untied, tied, (motion, _) = case
    samples = tied.samples(modelled(untied, motion, untied.prior, noise=0.0))
    generator = np.random.default_rng(5)
    errors = generator.normal(size=(DRAWS, *samples.force.shape))
    fits = [quiet_fit(samples.with_force(samples.force + error)) for error in errors]
    deviations = [(fit.values - tied.prior) / fit.standard_errors for fit in fits]
    intervals = np.array([fit.intervals() for fit in fits])
    return np.array(deviations), (intervals[..., 0] <= tied.prior) & (
        tied.prior <= intervals[..., 1]
    )


def test_intervals_cover_the_true_values(found):
    deviations, held = found
    assert np.abs(deviations).max() < 4.5
    assert np.abs(deviations.mean(axis=0)).max() < 4 / np.sqrt(DRAWS)
    assert 0.85 < deviations.std() < 1.15
    assert 0.9 < held.mean() < 0.99


def test_sharing_makes_predictions_surer(case):
    _, untied, tied, (motion, fresh) = case
    data = modelled(untied, motion, untied.prior, seed=6)
    errors = []
    for model in (untied, tied):
        fit = WeightedLeastSquares().fit(model.samples(data).problem)
        errors.append(prediction_reach(model.regressor(fresh), fit.covariance) / 1.96)
    loose, shared = errors
    # Of the motors' errors, other residuals leave other estimates.
    assert (shared < 1.05 * loose).all()
    assert shared.mean() < 0.8 * loose.mean()


def test_only_the_group_that_is_heavier_is_corrected():
    model = model_of("3rrr", True)
    robot = model.robot
    motions = [wander(robot, seed, 30.0, size=[0.3] * 3) for seed in (1, 2)]
    heavier = changed(robot, lower_mx=0.1)
    data = [
        [record(robot, motion, None, heavier, noise=0.2, seed=k)]
        for k, motion in enumerate(motions)
    ]
    found = quietly(identify, model, data[0], validation=data[1])
    reduction = eliminate(found)
    essential = judge_essential(found, reduction)
    truth = model.base.values(heavier)
    moved = [name for name, off in zip(model.base.names, truth - model.prior, strict=True) if off]
    assert set(reduction.result.parameters.labels) == set(moved)
    assert essential.beats_baseline
    errors = np.sqrt(np.diag(essential.fit.covariance))
    assert (np.abs(essential.fit.values - truth) <= 4.5 * errors).all()


def test_the_prior_is_the_mean_of_what_the_file_says(tmp_path, load_once):
    robot = load_once("3rrr")
    text = robot.path.with_suffix(".urdf").read_text()
    link = re.search(r'<link name="leg2_lower">.*?</link>', text, re.DOTALL)[0]
    other = re.sub(r'mass value="(.*?)"', lambda m: f'mass value="{float(m[1]) + 3}"', link)
    (tmp_path / "3rrr.urdf").write_text(text.replace(link, other))
    (tmp_path / "3rrr.yaml").write_text(robot.path.read_text())
    with pytest.warns(ModelWarning, match="leg2_lower"):
        unlike, loose = (loopid.load(tmp_path / "3rrr.yaml", tied=tied) for tied in (True, False))
    values = dict(zip(loose.parameters().labels, loose.standard_parameters(), strict=True))
    links = {group.name: group.links for group in unlike.identical}
    parts = [label.rpartition(".") for label in unlike.parameters().labels]
    mean = [
        np.mean([values[f"{link}.{kind}"] for link in links.get(name, (name,))])
        for name, _, kind in parts
    ]
    model = loopid.force_model(unlike, "full", None)
    np.testing.assert_allclose(model.prior, model.base.values(mean), rtol=1e-9, atol=1e-12)
    assert np.abs(model.prior - model_of("3rrr", True).prior).max() > 0.1
