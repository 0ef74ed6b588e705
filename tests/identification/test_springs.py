"""Springs in logs: they are found, intervals cover them, and they are rejected where none is."""

import numpy as np
import pytest

import loopid
from loopid import FitOptions, JointTerms, identify
from loopid.identification import compare_terms
from loopid.identification.fitting import quiet_fit
from loopid.motion import scaled_bodies
from made_runs import modelled, quietly, record, wander, with_deviation

# Linear at a motor, polynomial at the other one, piecewise linear at a passive joint.
SPRINGS = (
    "Fc=0.1,Fv=0.05; left_crank_joint: Ks=0.8,Fo=-1.2; right_crank_joint: Ks3=0.3,Ks2=-0.4,Ks=0.5;"
    "left_coupler_joint: Ks=0.4,Ks@-1.4=0.7,Fo=0.2"
)
DRAWS = 40


@pytest.fixture(scope="module")
def sprung(load_once):
    """A force model with springs, its true values, and a motion that excites all of it."""
    robot = load_once("five_bar")
    terms, values = JointTerms.with_values(robot, SPRINGS)
    model = loopid.force_model(robot, "full", terms)
    truth = model.base.values(np.concatenate([robot.standard_parameters(), values]))
    return model, truth, wander(robot, 4, 20.0, 20.0, size=(0.5, 0.5), harmonics=8)


def test_springs_are_found_exactly_without_noise(sprung):
    model, truth, motion = sprung
    samples = model.samples(modelled(model, motion, truth, noise=0.0))
    found = quiet_fit(samples).values
    assert len(model.joint_columns) == 13  # as many as there are terms: none is folded
    np.testing.assert_allclose(found, truth, rtol=1e-6, atol=1e-8)


def test_intervals_of_springs_cover_them(sprung):
    model, truth, motion = sprung
    samples = model.samples(modelled(model, motion, truth, noise=0.0))
    inside = []
    for seed in range(DRAWS):
        error = np.random.default_rng(seed).normal(scale=0.02, size=samples.force.shape)
        intervals = quiet_fit(samples.with_force(samples.force + error)).intervals()
        covered = (intervals[:, 0] <= truth) & (truth <= intervals[:, 1])
        inside.append(covered[model.joint_columns])
    assert 0.92 <= np.mean(inside) <= 0.98


@pytest.fixture(scope="module")
def suspected(load_once):
    """A force model with a spring at one motor, and motions to fit and to validate."""
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "full", JointTerms.of(robot, "Fc,Fv; left_crank_joint: Ks"))
    return model, [wander(robot, seed, 20.0, 10.0, size=(0.5, 0.5)) for seed in (4, 5)]


def logs(suspected, values, seed):
    """Recordings of a robot whose bodies are off the file by 20 %."""
    model, motions = suspected
    robot = model.robot
    terms, bodies = JointTerms.with_values(robot, values), scaled_bodies(robot, 0.2, seed)
    return [
        [record(robot, motion, terms, bodies, 0.05, 2 * seed + k)]
        for k, motion in enumerate(motions)
    ]


def comparison(suspected, values, seed, choices=(), deviation=0.2):
    """Term sets judged on the log of such a robot."""
    fitted, unseen = logs(suspected, values, seed)
    found = quietly(identify, suspected[0], fitted, validation=unseen)
    return compare_terms(with_deviation(found, deviation), choices=choices)


@pytest.mark.parametrize("draws", [4, pytest.param(200, marks=pytest.mark.validate)])
def test_a_spring_that_is_not_there_is_rejected(suspected, draws):
    found = [comparison(suspected, "Fc=0.1,Fv=0.05", seed).enough[1] for seed in range(draws)]
    assert np.mean(["Ks" in each.choice for each in found]) <= 0.05


def test_each_term_is_bought_where_it_is_there(suspected):
    friction, spring = "Fc=0.1,Fv=0.05", "; left_crank_joint: Ks=4,Fo=1"
    for values, enough in {
        "none": "none",
        "Fv=0.3": "Fv",
        friction: "Fc,Fv",
        friction + spring: "Fc,Fv; left_crank_joint: Ks,Fo",
        "Fc=0.3; left_coupler_joint: Fv=0.4": "Fc; left_coupler_joint: Fv",
    }.items():
        found = comparison(suspected, values, 0, ["Fc; left_coupler_joint: Fv"])
        assert found.enough[1].choice == enough
        assert found.chosen.choice == "Fc,Fv; left_crank_joint: Ks,Fo"
        assert found.bodies_pay
        lacking = "coupler" in enough  # all other sets are parts of the chosen one
        assert (found.missing is not None) == lacking


def test_the_rate_of_stribeck_friction_is_profiled(suspected):
    sets = [f"Fc,Fv,Fs~{rate:g}" for rate in (0.05, 0.1, 0.2, 0.4, 0.8)]
    found = comparison(suspected, "Fc=0.3,Fv=0.1,Fs~0.2=0.6", 1, sets)
    assert found.enough[1].choice == "Fc,Fv,Fs~0.2"


def test_sets_are_fitted_by_least_squares(suspected):
    """The chosen terms with the bodies of the robot file, and with all parameters free."""
    model, values = suspected[0], "Fc=0.1,Fv=0.05; left_crank_joint: Ks=1"
    fitted, unseen = (model.samples(run) for (run,) in logs(suspected, values, 3))
    fit = quiet_fit(fitted)
    with_file = model.prior.copy()
    with_file[model.joint_columns] = quiet_fit(
        fitted.reduced(model.joint_columns, with_file)
    ).values
    found = comparison(suspected, values, 3, deviation=None).chosen
    assert found.parameters == (6, 17)
    for error, phi in zip(found.errors, (with_file, fit.values), strict=True):
        squares = (unseen.residual(phi) / fit.noise.deviation) ** 2
        assert error.mean == pytest.approx(squares[unseen.used].mean(), rel=0.05)


def test_terms_that_new_data_ask_for_are_a_finding(suspected, load_once):
    robot, sprung = load_once("five_bar"), "Fc,Fv; left_crank_joint: Ks,Fo"
    runs = logs(suspected, "Fc=0.1,Fv=0.05; left_crank_joint: Ks=4", 0)
    model = loopid.force_model(robot, "full", JointTerms(robot.actuated, ("Fc", "Fv")))
    options = FitOptions(compared=(sprung,))
    study = quietly(identify, model, runs[0], validation=runs[1], options=options)
    (found,) = (each for each in study.findings if "too few" in each.title)
    assert str(found).startswith(f"joint terms Fc,Fv are too few: with {sprung} errors")
    assert found.do == f'use terms="{sprung}"'
    own, best = study.term_sets.chosen, study.term_sets.missing
    assert best.errors[1].mean < 0.5 * own.errors[1].mean
