"""Candidates are judged by data that none of them has seen, with errors that hold."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

import loopid
from loopid import JointTerms
from loopid.identification import FitSamples, fit_joint_terms, judge
from loopid.identification.candidate import Candidate
from loopid.identification.fitting import quiet_fit
from loopid.identification.prediction import prediction_reach
from loopid.identification.quality import Quality, fit_quality
from loopid.motion import scaled_bodies
from loopid.parameters import ParameterSet
from made_runs import record, wander

NAMES = ParameterSet.from_labels(["body.m", "body.mx", "motor.Fc"])
MOTORS = ("one", "two")
TRUTH = np.array([5.0, -1.0, 2.0])
SIGMA = np.array([1.0, 10.0])  # of the motors' errors
ROWS = 600
DRAWS = 80


def made(seed, noise_seed=None, used=None):
    """Samples with white errors; the motion is that of the seed."""
    generator = np.random.default_rng(seed)
    W = generator.normal(size=(ROWS, 2, 3))
    noise = np.random.default_rng([seed, noise_seed or 0]).normal(size=(ROWS, 2))
    return FitSamples.of(NAMES, MOTORS, W, W @ TRUTH + SIGMA * noise, used=used)


def off(mass=0.0, lever=0.0):
    """Values beside the truth."""
    return TRUTH + np.array([mass, lever, 0.0])


@cache
def fitted():
    """Training samples and their fit."""
    data = made(0)
    return data, quiet_fit(data)


def fit_of(values):
    """The fit of the training samples, with other values."""
    data, fit = fitted()
    quality = fit_quality(data.problem, values)
    return replace(fit, values=values, quality=quality, assumed=("motor.Fc",))


def judged(validation, values, baseline):
    data, _ = fitted()
    return judge(fit_of(values), data, validation, name="any", against=fit_of(baseline))


def test_the_baseline_is_as_good_as_itself():
    found = judged(made(1), TRUTH, TRUTH)
    assert found.error_ratio == (1.0, 0.0)
    assert not found.beats_baseline


def test_the_ratio_is_the_geometric_mean_of_those_of_the_motors():
    values, baseline = off(0.3), off(lever=0.5)
    validation = made(2)
    squares = [(validation.residual(phi) ** 2).mean(axis=0) for phi in (values, baseline)]
    found = judged(validation, values, baseline)
    np.testing.assert_allclose(found.motor_ratios, squares[0] / squares[1], rtol=1e-12)
    assert found.error_ratio[0] == pytest.approx(np.sqrt(np.prod(found.motor_ratios)), rel=1e-12)


def test_one_motor_that_gains_much_counts_for_much():
    """From 46 to 4 % of a force in one of two motors, and no change in the other."""
    values, baseline = TRUTH, TRUTH + np.array([0.0, 0.0, 12.0])
    validation = made(2)
    W = np.array(validation.regressor)
    W[:, 1, 2] = 0.0  # the second motor has no such friction
    validation = replace(validation, regressor=W, force=validation.force)
    found = judged(validation, values, baseline)
    assert found.motor_ratios[0] < 0.02
    assert found.motor_ratios[1] == pytest.approx(1.0)
    assert found.error_ratio[0] < 0.15
    assert found.beats_baseline


def test_unused_samples_do_not_count():
    used = np.ones((ROWS, 2), dtype=bool)
    used[100:250, 0] = used[400:, 1] = False
    clean = made(4, used=used)
    spoilt = clean.with_force(np.where(used, clean.force, 1e6))
    values, baseline = off(0.3), off(lever=0.5)
    assert judged(spoilt, values, baseline).error_ratio == pytest.approx(
        judged(clean, values, baseline).error_ratio, rel=1e-12
    )


def test_a_motor_that_never_takes_part_leaves_the_verdict_to_the_others():
    used = np.ones((ROWS, 2), dtype=bool)
    used[:, 1] = False
    values, baseline = off(0.3), off(lever=0.5)
    found = judged(made(5, used=used), values, baseline)
    squares = [(made(5).residual(phi)[:, 0] ** 2).mean() for phi in (values, baseline)]
    assert found.error_ratio[0] == pytest.approx(squares[0] / squares[1], rel=1e-12)
    assert np.isfinite(found.error_ratio[1])


@pytest.mark.parametrize(
    ("values", "baseline"),
    [
        (off(), off(0.3, -0.3)),
        pytest.param(off(0.3, -0.3), off(), marks=pytest.mark.validate),
        pytest.param(off(), off(12.0, 9.0), marks=pytest.mark.validate),
    ],
    ids=["a little better", "a little worse", "far better"],
)
def test_standard_errors_are_the_spread_over_draws_of_the_errors(values, baseline):
    """Those of the ratio, and of each motor's rms."""
    found = [judged(made(6, draw), values, baseline) for draw in range(1, DRAWS + 1)]
    numbers = [[one.error_ratio[0], *one.validation.residual_rms] for one in found]
    errors = [[one.error_ratio[1], *one.rms_errors[1]] for one in found]
    spread, told = np.std(numbers, axis=0, ddof=1), np.mean(errors, axis=0)
    assert ((told / spread > 0.75) & (told / spread < 1.33)).all()


@pytest.mark.parametrize(
    ("ratio", "error", "better"),
    [(0.9, 0.04, True), (0.9, 0.06, False), (1.0, 0.0, False), (1.2, 0.01, False)],
)
def test_two_standard_errors_make_a_candidate_better(ratio, error, better):
    nothing = Quality(np.zeros(2), np.zeros(2), np.zeros(2, dtype=int))
    ratios = {"error_ratio": (ratio, error), "motor_ratios": np.full(2, ratio)}
    fit, forces = fit_of(TRUTH), np.zeros((ROWS, 2))
    found = Candidate("any", fit, nothing, forces, (SIGMA, SIGMA), **ratios)
    assert found.beats_baseline is better


def test_round_off_makes_no_candidate_better():
    values = TRUTH * (1 + 1e-15)
    found = judged(made(7), values, TRUTH)
    assert abs(found.error_ratio[0] - 1) < 1e-12
    for seed in range(10):
        nearly = TRUTH * (1 + 1e-14 * np.random.default_rng(seed).normal(size=3))
        assert not judged(made(seed), nearly, TRUTH).beats_baseline


def test_qualities_are_those_of_the_data_they_are_named_after():
    training, validation = made(0), made(8)
    found = judged(validation, TRUTH, TRUTH)
    for quality, samples in ((found.fit.quality, training), (found.validation, validation)):
        expected = np.sqrt((samples.residual(TRUTH) ** 2).mean(axis=0))
        np.testing.assert_allclose(quality.residual_rms, expected, rtol=1e-9)
    assert (found.name, found.fitted) == ("any", 2)


def test_errors_of_predictions_are_the_spread_of_predictions_over_draws():
    generator = np.random.default_rng(9)
    spread = generator.normal(size=(3, 3))
    covariance, W = spread @ spread.T, generator.normal(size=(20, 2, 3))
    draws = generator.multivariate_normal(np.zeros(3), covariance, size=20_000)
    expected = np.einsum("nij,kj->nik", W, draws).std(axis=2)
    np.testing.assert_allclose(prediction_reach(W, covariance), 1.96 * expected, rtol=0.03)


def test_nothing_fitted_has_no_error_of_prediction():
    W = np.random.default_rng(1).normal(size=(5, 2, 3))
    assert not prediction_reach(W, np.zeros((3, 3))).any()
    # A covariance that round-off has made slightly negative gives 0 rather than NaN.
    assert np.isfinite(prediction_reach(W, -1e-20 * np.eye(3))).all()


def test_an_rms_of_a_motor_that_never_takes_part_has_no_error():
    used = np.ones((ROWS, 2), dtype=bool)
    used[:, 1] = False
    errors = judged(made(5, used=used), off(0.3), TRUTH).rms_errors[1]
    assert np.isnan(errors).tolist() == [False, True]


GIVEN = {"Fo": 0.03, "Ia": 0.02}


def given_bodies(model, part):
    """Errors and half widths (k,) of offsets and rotors, with bodies that are off the file."""
    robot, found = model.robot, []
    terms = JointTerms.with_values(robot, "Fc=0.3,Fv=0.1,Fo=0.03,Ia=0.02")
    for seed in range(3):
        motion = wander(robot, seed, 12.0, 50.0, size=(0.5, 0.5))
        bodies = scaled_bodies(robot, part, seed=seed) if part else robot.standard_parameters()
        data = model.samples(record(robot, motion, terms, bodies, 0.02, seed))
        fit = fit_joint_terms(model, data, noise=quiet_fit(data).noise)
        for joint, kind in product(robot.actuated, GIVEN):
            low, high = fit.standard[f"{joint}.{kind}"].interval
            found.append((abs((low + high) / 2 - GIVEN[kind]), (high - low) / 2))
    return np.transpose(found)


def test_offsets_and_rotors_hold_by_how_much_given_bodies_are_off(load_once):
    model = loopid.force_model(load_once("five_bar"), "full", "Fc,Fv,Fo,Ia")
    right, little, far = (given_bodies(model, part) for part in (0.0, 0.02, 0.2))
    for errors, reach in (right, little, far):
        assert (errors <= reach).mean() >= 0.9
    assert 4 < np.median(little[1] / right[1]) < np.median(far[1] / right[1]) / 4
    assert np.median(right[1]) < 0.005
