"""Filters chosen from the log: what they keep, and whether intervals from noisy logs hold."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from loopid import (
    FilterOptions,
    FourierSeries,
    JointTerms,
    find_force_model,
    joint_motion,
    load_mechanism,
    predict,
    prepare_recording,
    read_fit,
    read_motion_program,
    save_fit,
    simulate_measurement,
)
from loopid.diagnosis.bands import sweep_fit
from loopid.errors import DataWarning, LogError
from loopid.identification import quiet_fit
from loopid.logs import Log, motion_spectrum
from made_runs import quietly

STEP = 2 * np.pi / 2**17  # rad, of the encoders
NOISE = 0.02  # N m, of the forces
FRICTION = np.array([0.1, 0.05, 0.1, 0.05])


@cache
def simulated(motion, rate, choice="Fc,Fv"):
    """A five-bar with friction: its force model, true values, and an exact measurement."""
    robot = load_mechanism("five_bar")
    terms = JointTerms.of(robot, choice)
    model = find_force_model(robot, "full", terms)
    if motion == "fourier":
        sine, cosine = np.random.default_rng(0).normal(size=(2, 2, 5)) * 0.25 / np.arange(1, 6)
        planned = FourierSeries(robot.actuated, 0.1, np.array([2.088, 0.714]), sine, cosine)
        moved = joint_motion(robot, planned.motion(rate=rate, duration=20.0))
    else:
        moved = joint_motion(robot, read_motion_program("five_bar").motion(motion, rate))
    friction = np.resize(FRICTION, len(terms.parameters(robot)))
    run = simulate_measurement(robot, moved, joint_terms=terms, joint_values=friction)
    truth = model.base.values(np.concatenate([robot.standard_parameters("full"), friction]))
    return model, truth, run


def log_of(model, run, step=0.0, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    zero = step * rng.uniform(size=2)
    position = step * np.round((run.position - zero) / step) + zero if step else run.position
    force = run.force + noise * rng.normal(size=run.force.shape)
    return Log.from_arrays(run.time, position, force, model.mechanism.actuated, name="run")


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_the_band_is_that_of_the_motion_at_any_rate_and_resolution(rate):
    model, _, run = simulated("fourier", rate)
    for step in (0.0, STEP, STEP / 8):
        found = motion_spectrum(log_of(model, run, step))
        assert 0.4 < found.band < 0.7  # five harmonics of 0.1 Hz
        assert 5 * found.band <= found.cutoff <= 20 * found.band + 1e-9


def test_the_noise_of_the_encoders_is_what_their_steps_make():
    model, _, run = simulated("fourier", 1000.0)
    found = motion_spectrum(log_of(model, run, STEP))
    high = found.frequency > 100
    np.testing.assert_allclose(found.density[high] / found.noise[high], 1.0, atol=0.5)
    # Of both cranks: density of positions over the power of their accelerations.
    white = 2 * STEP**2 / 12 / 1000 * (2 * np.pi) ** 4
    power = (np.diff(run.position, 2, axis=0) * 1e6).var(axis=0)
    at = np.searchsorted(found.frequency, 20.0)
    expected = white * found.frequency[at] ** 4 * (1 / power).sum()
    assert found.noise[at] == pytest.approx(expected, rel=0.3)


def test_a_log_that_stands_has_no_band():
    model, _, run = simulated("fourier", 100.0)
    still = log_of(model, run)
    assert motion_spectrum(replace(still, position=0 * still.position)).band == 0


@pytest.mark.parametrize("count", [1, 3, 5, 16, 60])
def test_a_log_of_few_samples_is_too_short_to_filter(count):
    model, _, run = simulated("fourier", 100.0)
    whole = log_of(model, run)
    few = whole.select(np.arange(len(whole)) < count)
    with pytest.raises(LogError, match=f"too short to filter, the longest has {count} samples"):
        prepare_recording(model.mechanism, few)


@pytest.mark.parametrize("motion", ["fourier", "sweep"])
@pytest.mark.parametrize("cutoff", [5.0, 20.0])
@pytest.mark.parametrize("choice", ["Fc,Fv", "Fc,Fv; left_coupler_joint: Fc,Fv"])
def test_steps_of_friction_pass_the_filter_of_the_forces(motion, cutoff, choice):
    model, truth, run = simulated(motion, 100.0, choice)
    options = FilterOptions(cutoff=cutoff)
    recording = prepare_recording(model.mechanism, log_of(model, run), filter=options)
    samples = model.samples(recording)
    left = np.where(samples.used, samples.residual(truth), 0.0)
    # What a joint without motor does is known where the loops are closed, not at the ends.
    assert np.abs(left[2:]).max() < 0.03 * FRICTION[0]
    assert np.abs(left).max() < 0.06 * FRICTION[0]
    if (motion, cutoff) == ("fourier", 5.0):
        # The sign of the filtered velocity is off by much of the friction.
        plain = recording.force - model.regressor(recording.motion) @ truth
        assert np.abs(plain[samples.used]).max() > 0.3 * FRICTION[0]
    # A part of a recording has the same rows.
    part = model.samples(recording.select(slice(20, 50)))
    np.testing.assert_array_equal(part.regressor, samples.regressor[20:50])


def covered(motion, rate, step, runs):
    """Part of the intervals that cover (n,), and errors in standard errors (runs, n)."""
    model, truth, run = simulated(motion, rate)
    inside, errors = [], []
    for seed in range(runs):
        log = log_of(model, run, step, NOISE, seed)
        fit = quiet_fit(model.samples(quietly(prepare_recording, model.mechanism, log)))
        low, high = fit.intervals().T
        inside.append((low <= truth) & (truth <= high))
        errors.append((fit.values - truth) / fit.standard_errors)
    return np.mean(inside, axis=0), np.array(errors)


def test_intervals_hold_with_encoder_steps_at_a_high_rate():
    rates, errors = covered("fourier", 1000.0, STEP, 6)
    # A twentieth of the rate as cut-off gives means of 4 and a root mean square of 1.8.
    assert rates.mean() > 0.8
    assert np.abs(errors.mean(axis=0)).max() < 1.6
    assert np.sqrt((errors**2).mean()) < 1.4


def test_a_cutoff_that_lets_noise_bias_the_estimates_is_told():
    model, _, run = simulated("fourier", 1000.0)
    log = log_of(model, run, STEP, NOISE)

    def swept(**options):
        recording = quietly(
            prepare_recording, model.mechanism, log, filter=FilterOptions(**options)
        )
        samples = model.samples(recording)
        return sweep_fit(samples, [recording], quiet_fit(samples))

    assert swept().moved == ()
    wide = swept(cutoff=50.0)
    assert "left_crank.mx" in wide.moved
    with pytest.warns(DataWarning, match=r"left_crank.mx"):
        wide.warn()
    # Unfiltered, there is no band to narrow.
    plain = quietly(prepare_recording, model.mechanism, log, filter=FilterOptions(cutoff=None))
    assert sweep_fit(model.samples(plain), [plain], None) is None


@pytest.mark.validate
@pytest.mark.parametrize("motion", ["fourier", "sweep"])
@pytest.mark.parametrize("step", [STEP, STEP / 8])
@pytest.mark.parametrize("rate", [100.0, 500.0, 1000.0, 5000.0])
def test_intervals_hold_at_all_rates(motion, step, rate):
    rates, errors = covered(motion, rate, step, 50)
    assert 0.90 < rates.mean() < 0.985
    assert rates.min() >= 0.8
    assert np.abs(errors.mean(axis=0)).max() < 0.6


def test_predicted_friction_passes_the_filter_of_the_forces(tmp_path):
    model, truth, run = simulated("fourier", 1000.0)
    robot = model.mechanism
    recording = quietly(prepare_recording, robot, log_of(model, run))
    fit = read_fit(save_fit(tmp_path / "fit.json", model, truth))
    found = predict(fit, robot, recording)
    assert np.abs(found.predicted - recording.force).max() < 0.01 * FRICTION[0]
