"""Filters chosen from the log: what they keep, and whether intervals from noisy logs hold."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from loopid import FilterOptions, FitOptions, JointTerms, identify, identify_payload, load_fit
from loopid.errors import DataWarning, LogError
from loopid.identification import choose_cutoff, split_recordings
from loopid.identification.fitting import quiet_fit
from loopid.logs import Log
from loopid.logs.preparing import motion_band
from loopid.motion import FourierSeries, joint_motion, read_motion_program
from made_runs import identify_unjudged, quietly

pytestmark = pytest.mark.usefixtures("nothing_suspected", "no_delay_sought", "none_missing")

STEP = 2 * np.pi / 2**17  # rad, of the encoders
NOISE = 0.02  # N m, of the forces
FRICTION = np.array([0.1, 0.05, 0.1, 0.05])


@cache
def simulated(motion, rate, choice="Fc,Fv", seconds=20.0):
    """A five-bar with friction: its force model, true values, and an exact measurement."""
    robot = loopid.load("five_bar")
    terms = JointTerms.of(robot, choice)
    model = loopid.force_model(robot, "full", terms)
    if motion == "fourier":
        sine, cosine = np.random.default_rng(0).normal(size=(2, 2, 5)) * 0.25 / np.arange(1, 6)
        planned = FourierSeries(robot.actuated, 0.1, np.array([2.088, 0.714]), sine, cosine)
        moved = joint_motion(robot, planned.motion(rate=rate, duration=seconds))
    else:
        moved = joint_motion(robot, read_motion_program("five_bar").motion(motion, rate))
    friction = np.resize(FRICTION, len(terms.parameters(robot)))
    run = loopid.simulate(robot, moved, joint_terms=terms, joint_values=friction)
    truth = model.base.values(np.concatenate([robot.standard_parameters("full"), friction]))
    return model, truth, run


def log_of(model, run, step=0.0, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    zero = step * rng.uniform(size=2)
    position = step * np.round((run.position - zero) / step) + zero if step else run.position
    force = run.force + noise * rng.normal(size=run.force.shape)
    return Log.from_arrays(run.time, position, force, model.robot.actuated, name="run")


@pytest.mark.parametrize("rate", few_of([100.0, 1000.0], 100.0))
def test_the_band_is_that_of_the_motion_whatever_the_noise(rate):
    model, _, run = simulated("fourier", rate)
    for log in (log_of(model, run, step) for step in (0.0, STEP, 2**5 * STEP)):
        held = log.position[np.arange(len(log)) // 5 * 5]
        jitter = 0.2 / rate * np.random.default_rng(0).normal(size=(len(log), 1))
        early = log.position + np.gradient(log.position, 1 / rate, axis=0) * jitter
        for position in (log.position, held, early):
            found = motion_band(model.robot, replace(log, position=position))
            assert 0.4 < found < 0.7  # five harmonics of 0.1 Hz


def test_the_band_of_a_crank_that_turns_steadily_is_that_of_its_turns():
    """Its rate has no frequency, its forces have those of the turns."""
    robot = loopid.load("four_bar")
    time = np.arange(2000) / 100
    log = Log.from_arrays(time, 2 * np.pi * 0.8 * time[:, None], 0 * time[:, None], robot.actuated)
    assert motion_band(robot, log) == pytest.approx(0.8, abs=0.1)


def test_a_log_that_stands_has_no_band():
    model, _, run = simulated("fourier", 100.0)
    still = log_of(model, run)
    still = replace(still, position=0 * still.position)
    assert motion_band(model.robot, still) == 0


@cache
def coarse(bits, rate=100.0, noise=NOISE):
    """A log of encoders of this many bits, its force model and true values."""
    model, truth, run = simulated("fourier", rate)
    return model, truth, log_of(model, run, 2 * np.pi / 2**bits, noise)


@cache
def prepared(bits, rate=100.0):
    model, _, log = coarse(bits, rate)
    return quietly(loopid.prepare, model.robot, log)


@cache
def choice_of(bits, rate=100.0):
    """What is chosen for that log."""
    return choose_cutoff(coarse(bits, rate)[0], [prepared(bits, rate)])


@pytest.mark.validate
def test_a_coarse_encoder_asks_for_a_narrow_band():
    narrow, wide = (choice_of(bits).chosen for bits in (10, 17))
    assert 1 < narrow < 4
    assert narrow < wide < 25


@pytest.mark.parametrize("bits", few_of([10, 12, 14], 12))
def test_the_chosen_cut_off_predicts_as_well_as_the_best_and_coarse_encoders_stay(bits):
    model, truth, log = coarse(bits)
    robot = model.robot
    planned = read_motion_program("five_bar").motion("sweep", 20.0)
    new = model.regressor(joint_motion(robot, planned))

    def error(cutoff):
        options = FilterOptions(cutoff=cutoff)
        recording = quietly(loopid.prepare, robot, log, filter=options)
        return float(((new @ (quiet_fit(model.samples(recording)).values - truth)) ** 2).mean())

    assert not any("frozen" in str(dropped) for dropped in prepared(bits).dropped)
    choice = choice_of(bits)
    errors = [error(cutoff) for cutoff in choice.cutoffs]
    assert error(choice.chosen) < 4 * min(errors)
    assert max(errors) > 20 * min(errors)  # so that it matters


def test_a_cut_off_that_is_given_is_kept_and_a_known_motion_has_none():
    model, _, log = coarse(17)
    options = FilterOptions(cutoff=7.0)
    given = quietly(loopid.prepare, model.robot, log, filter=options)
    assert choose_cutoff(model, [given]) is None
    assert choose_cutoff(model, [replace(given, log=None, filter=None)]) is None
    found = quietly(identify, model, [given])
    assert found.cutoff is None
    assert {run.cutoff for run in (*found.training, *found.validation)} == {7.0}


@pytest.mark.parametrize("fraction", few_of([None, 0.6], 0.6))
def test_identify_prepares_all_recordings_at_the_choice(fraction):
    model, recording = coarse(17)[0], prepared(17)
    options = FitOptions(fraction=fraction)
    found = quietly(identify, model, [recording], friction=[recording], options=options)
    assert bool(found.validation) == bool(fraction)
    runs = (*found.training, *found.validation, *found.friction)
    assert {run.cutoff for run in runs} == {found.cutoff.chosen}
    # All that is fitted chooses; new data have no say.
    fitted = split_recordings([recording], fraction)[0] if fraction else [recording]
    assert choose_cutoff(model, fitted) == found.cutoff


def test_a_choice_at_a_bound_is_told():
    model, _, log = coarse(17, 10.0, NOISE / 100)
    choice = choose_cutoff(model, [quietly(loopid.prepare, model.robot, log)])
    assert choice.bound == "rate"
    assert choice.chosen == pytest.approx(10.0 / 5)
    words = {
        "rate": "motion is lost",
        "lowest": "band of the motion",
        "length": "length of the log",
    }
    for bound, said in {**words, "alone": "only one cut-off"}.items():
        with pytest.warns(DataWarning, match=f"{choice.chosen:.3g} Hz") as told:
            replace(choice, bound=bound).warn()
        assert said in str(told[0].message)


@pytest.mark.parametrize(
    ("rate", "bits"), few_of([(20.0, 17), (100.0, 17), (1000.0, 14)], (100.0, 17))
)
def test_clean_logs_are_at_no_bound(rate, bits):
    assert not choice_of(bits, rate).bound


def test_ten_forces_a_parameter_are_left():
    model, _, log = coarse(17)
    count = len(model.parameters)
    part = log.select(np.asarray(log.time) < 5.0)
    choice = choose_cutoff(model, [quietly(loopid.prepare, model.robot, part)])
    first = FilterOptions(cutoff=float(choice.cutoffs[0]))
    samples = model.samples(quietly(loopid.prepare, model.robot, part, filter=first))
    assert 10 * count <= samples.problem.rows < 20 * count


def test_the_change_from_a_cut_off_to_the_next_is_that_of_forces_in_parts_of_the_errors():
    model, _, log = coarse(12)
    recording, choice = prepared(12), choice_of(12)
    judge = model.samples(recording)
    fits = [
        quiet_fit(model.samples(quietly(loopid.prepare, model.robot, log, filter=options)))
        for options in (FilterOptions(cutoff=float(each)) for each in choice.cutoffs[1:3])
    ]
    moved = np.where(judge.used, judge.predicted(fits[1].values - fits[0].values), 0.0)
    errors = quiet_fit(judge).quality.residual_rms
    change = np.sqrt(((moved / errors) ** 2).sum() / judge.problem.rows)
    assert choice.changes[1] == pytest.approx(change, rel=0.1)


def test_slow_motions_that_start_and_stop_quickly_have_a_band():
    """Half of the power is below 0.1 Hz, and steps of noise go on to the highest frequency."""
    robot = loopid.load("five_bar")
    time = np.arange(0, 80, 0.01)
    slow = 0.3 * np.sin(2 * np.pi * 0.03 * time) + 0.02 * np.tanh(50 * np.sin(0.1 * np.pi * time))
    position = np.round(np.stack([2.088 + slow, 0.714 + slow], axis=1) / 1e-4) * 1e-4
    log = Log.from_arrays(time, position, 0 * position, robot.actuated)
    assert 0.03 < motion_band(robot, log) < 5


@pytest.mark.parametrize("count", [1, 3, 5, 16, 60])
def test_a_log_of_few_samples_is_too_short_to_filter(count):
    model, _, run = simulated("fourier", 100.0)
    whole = log_of(model, run)
    few = whole.select(np.arange(len(whole)) < count)
    short = f"too short to filter, the longest has {count} samples"
    with pytest.raises(LogError, match=short if count > 1 else "nothing moves"):
        loopid.prepare(model.robot, few)


@pytest.mark.parametrize("motion", few_of(["fourier", "sweep"], "fourier"))
@pytest.mark.parametrize("cutoff", few_of([5.0, 20.0], 5.0))
@pytest.mark.parametrize("choice", ["Fc,Fv", "Fc,Fv; left_coupler_joint: Fc,Fv"])
def test_steps_of_friction_pass_the_filter_of_the_forces(motion, cutoff, choice):
    model, truth, run = simulated(motion, 100.0, choice)
    options = FilterOptions(cutoff=cutoff)
    recording = loopid.prepare(model.robot, log_of(model, run), filter=options)
    samples = model.samples(recording)
    left = np.where(samples.used, samples.residual(truth), 0.0)
    # A joint without motor, too, and at the ends, where no loops are closed.
    assert np.abs(left).max() < 0.015 * FRICTION[0]
    if (motion, cutoff) == ("fourier", 5.0):
        # The sign of the filtered velocity is off by much of the friction.
        plain = recording.force - model.regressor(recording.motion) @ truth
        assert np.abs(plain[samples.used]).max() > 0.3 * FRICTION[0]
    # A part of a recording has the same rows.
    part = model.samples(recording.select(slice(20, 50)))
    np.testing.assert_array_equal(part.regressor, samples.regressor[20:50])


def covered(motion, rate, step, runs, seconds=20.0):
    """Part of the intervals that cover (n,), and errors in standard errors (runs, n)."""
    model, truth, run = simulated(motion, rate, seconds=seconds)
    inside, errors = [], []
    for seed in range(runs):
        log = log_of(model, run, step, NOISE, seed)
        fit = quiet_fit(model.samples(quietly(loopid.prepare, model.robot, log)))
        low, high = fit.intervals().T
        inside.append((low <= truth) & (truth <= high))
        errors.append((fit.values - truth) / fit.standard_errors)
    return np.mean(inside, axis=0), np.array(errors)


@pytest.mark.validate
def test_intervals_hold_with_encoder_steps_at_a_high_rate():
    rates, errors = covered("fourier", 1000.0, STEP, 4, seconds=10.0)
    # A twentieth of the rate as cut-off gives means of 4 and a root mean square of 1.8.
    assert rates.mean() > 0.8
    assert np.abs(errors.mean(axis=0)).max() < 1.6
    assert np.sqrt((errors**2).mean()) < 1.4


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
    model, truth, run = simulated("fourier", 1000.0, seconds=10.0)
    robot = model.robot
    options = FilterOptions(cutoff=10.0)
    recording = quietly(loopid.prepare, robot, log_of(model, run), filter=options)
    fit = load_fit(loopid.Fit.of(model, truth).save(tmp_path / "fit.json"))
    found = fit.predict(recording)
    assert np.abs(found.predicted - recording.force).max() < 0.01 * FRICTION[0]


def test_a_saved_fit_predicts_with_the_filter_that_it_was_judged_with(tmp_path):
    (model, _, log), recording = coarse(12), prepared(12)
    found = identify_unjudged(model, recording)
    fit = load_fit(found.fit.save(tmp_path / "fit.json"))
    assert fit.cutoff == found.cutoff.chosen
    predicted = fit.predict(recording)
    assert predicted.recording.cutoff == found.cutoff.chosen
    given = quietly(
        loopid.prepare, model.robot, log, filter=FilterOptions(cutoff=7.0, decimate=False)
    )
    assert fit.predict(given).recording is given


@pytest.mark.validate
@pytest.mark.draws
def test_a_payload_is_found_with_the_filter_that_predicts_best():
    """Encoders of 10 bits: at the provisional cut-off of six bands the mass is far off."""
    robot = loopid.load("five_bar")
    model = loopid.force_model(robot, "full", "Fc,Fv")
    bodies, load = robot.standard_parameters("full"), 0.5
    first, runs = robot.parameters("full").labels.index("left_coupler.m"), []
    for carried in (0.0, load):
        heavier = bodies.copy()
        heavier[first : first + 2] += carried, 0.1 * carried
        moved = joint_motion(robot, read_motion_program("five_bar").motion("sweep", 1000.0))
        terms = JointTerms.of(robot, "Fc,Fv")
        run = loopid.simulate(
            *(robot, moved), standard_parameters=heavier, joint_terms=terms, joint_values=FRICTION
        )
        log = log_of(model, run, 2 * np.pi / 2**10, NOISE, seed=int(2 * carried))
        runs.append([quietly(loopid.prepare, robot, log)])
    found = quietly(identify_payload, model, *runs, link="left_coupler")
    k = found.parameters.labels.index("payload.m")
    low, high = found.intervals()[k]
    assert len(found.base.terms[k]) == 1
    assert low < load < high
    assert high - low < load
