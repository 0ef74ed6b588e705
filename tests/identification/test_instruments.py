"""Instruments from a reference."""

import numpy as np
import pytest

import loopid
from loopid import JointTerms
from loopid.errors import DataError
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_models import reference_instruments
from loopid.logs import Recording
from loopid.motion import FourierSeries, Motion, joint_motion
from loopid.motion.filtering import differentiate

RATE, NOISE, DRAWS = 100.0, 1e-4, 16


@pytest.fixture(scope="module")
def arm_model(arm):
    return loopid.force_model(arm, "full", JointTerms(arm.actuated, ("Fv",)))


@pytest.fixture(scope="module")
def truth(arm_model):
    values = arm_model.prior.copy()
    values[arm_model.joint_columns] = 2.0
    return values


@pytest.fixture(scope="module")
def reference(arm):
    sine, cosine = 0.4 * np.random.default_rng(0).normal(size=(2, 2, 3)) / np.arange(1, 4)
    return FourierSeries(arm.actuated, 0.25, np.array([0.5, -0.3]), sine, cosine).motion(6.0, RATE)


def measured(model, motion, truth, seed):
    """A recording whose positions have noise, and velocities and accelerations made of them."""
    robot, rng = model.robot, np.random.default_rng(seed)
    force = model.regressor(joint_motion(robot, motion)) @ truth
    position = motion.position + NOISE * rng.normal(size=motion.position.shape)
    velocity = differentiate(position, RATE)
    noisy = Motion(motion.names, motion.time, position, velocity, differentiate(velocity, RATE))
    errors = 0.1 * rng.normal(size=force.shape)
    return Recording.of_motion(joint_motion(robot, noisy), force + errors, robot.actuated)


@pytest.mark.validate
def test_the_reference_removes_the_bias_of_noisy_positions(arm, arm_model, truth, reference):
    assert_unbiased(arm, arm_model, truth, reference)


@pytest.mark.validate
def test_the_bias_of_a_closed_loop_is_removed_and_intervals_cover(load_once):
    """Errors of two encoders go through the closure into all rates and all columns."""
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "full", JointTerms(robot.actuated, ("Fv",)))
    truth = np.array(model.prior)
    truth[model.joint_columns] = 0.5
    plan = loopid.motion.read_motion_program("five_bar").motion("sweep", RATE)
    covered = assert_unbiased(robot, model, truth, plan)
    assert covered["iv"].mean() > 0.88
    assert covered["wls"].mean(axis=0).min() < 0.2


def assert_unbiased(robot, model, truth, reference):
    """By instruments, where least squares is biased; which intervals cover, by estimator."""
    commanded, found = joint_motion(robot, reference), {"wls": [], "iv": []}
    for seed in range(DRAWS):
        recording = measured(model, reference, truth, seed)
        instruments = reference_instruments(model, recording, commanded)
        samples = model.samples(recording).with_instruments(instruments)
        for name, fits in found.items():
            fits.append(quiet_fit(samples, name))
    errors = {name: np.array([f.values for f in fits]) - truth for name, fits in found.items()}
    doubt = {name: each.std(axis=0) / np.sqrt(DRAWS) for name, each in errors.items()}
    bias = {name: np.abs(each.mean(axis=0)) / doubt[name] for name, each in errors.items()}
    assert (bias["iv"] < 4).all()
    assert (bias["wls"] > 6).any()
    intervals = {name: np.array([f.intervals() for f in fits]) for name, fits in found.items()}
    return {n: (i[..., 0] <= truth) & (truth <= i[..., 1]) for n, i in intervals.items()}


def test_the_nearest_sample_of_the_reference_is_taken(arm, arm_model, truth, reference):
    recording = measured(arm_model, reference, truth, 0)
    commanded = joint_motion(arm, reference)
    rows = np.arange(10, 500, 7)
    part = recording.select(np.isin(np.arange(len(recording)), rows))
    expected = arm_model.regressor(commanded)[rows]
    np.testing.assert_allclose(reference_instruments(arm_model, part, commanded), expected)
    coarse = commanded.select(np.arange(0, 601, 2))
    found = reference_instruments(arm_model, recording, coarse)
    assert found.shape == (601, 2, len(truth))
    np.testing.assert_allclose(found[::2], arm_model.regressor(coarse))


def test_references_that_do_not_fit_are_refused(arm, arm_model, truth, reference, knee):
    recording, commanded = measured(arm_model, reference, truth, 0), joint_motion(arm, reference)
    early = commanded.select(np.arange(100))
    with pytest.raises(DataError, match=r"the reference lasts from 0 to 0\.99 s"):
        reference_instruments(arm_model, recording, early)
    with pytest.raises(DataError, match="at least two samples"):
        reference_instruments(arm_model, recording, commanded.select(np.arange(1)))
