"""Forces that a model lacks: which, how large, and what they would save; none where none is."""

from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import chdtrc, chdtri

import loopid
from bank_robots import few_of
from loopid import JointTerms
from loopid.identification import Delay, missing
from loopid.identification.fitting import working_fit
from loopid.identification.lengths import Place, length_forces
from loopid.identification.missing import _Search, _slow, _Test, missing_forces
from loopid.identification.sensor_noise import sensor_noise
from loopid.kinematics.loop_motion import closed_nearby
from loopid.logs import Recording
from loopid.motion import LowPass, Motion, joint_motion, scaled_bodies
from loopid.parameters import KINDS
from made_runs import identify_unjudged, quietly, record, unchecked, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared")

LEFT, RIGHT = "left_crank_joint", "right_crank_joint"


@pytest.fixture(scope="module")
def robot(load_once):
    return load_once("five_bar")


@pytest.fixture(scope="module")
def model(robot):
    return loopid.force_model(robot, "full", "Fc,Fv,Fo,Ia")


def run(robot, law=None, seed=0, noise=0.01):
    """A recording with a further force of the first motor: of time, positions and motion."""
    motion = wander(robot, 4, 20.0, 50.0, size=(0.5, 0.5))
    terms = JointTerms.with_values(robot, "Fc=0.1,Fv=0.05")
    plain = record(robot, motion, terms, scaled_bodies(robot, 0.2), noise, seed)
    force = plain.force.copy()
    if law is not None:
        q = motion.configurations[:, robot.joint(LEFT).idx_q]
        force[:, 0] += law(motion.time, q, motion.velocities, motion.accelerations)
    return Recording.of_motion(motion, force, robot.actuated)


@pytest.fixture(scope="module")
def with_law(robot, model, once):
    """What a recording with one of these laws identifies, or with none."""

    def found(law=None):
        return once(f"missing {law}", lambda: identify_unjudged(model, run(robot, LAWS.get(law))))

    return found


def clear(found):
    """Forces that are clearly missing."""
    return [each for each in found.missing if each.certainty == "clear"]


LAWS = {
    "waves over position": lambda t, q, v, a: 0.05 * np.sin(20 * q + 1.0),
    "drifts in time": lambda t, q, v, a: np.sign(v[:, 0]) * (t - 10) / 10 * 0.06,
    "grows with position": lambda t, q, v, a: 2.0 * (q - q.mean()),
    f"follows the motion of {RIGHT}": lambda t, q, v, a: 0.2 * v[:, 1],
}


@pytest.mark.parametrize("law", LAWS)
def test_a_missing_force_is_named_with_its_size_and_what_it_would_save(robot, with_law, law):
    found = with_law(law)
    (recording,) = found.training
    own = [each for each in clear(found) if each.motor == LEFT]
    assert [each.law for each in own] == [law]
    plain = run(robot)
    added = np.sqrt(((recording.force - plain.force)[:, 0] ** 2).mean())
    # What other parameters take up of it is a part of its size, too.
    assert 0.6 * added < own[0].size < 1.6 * added
    assert own[0].number == pytest.approx(20.0, abs=0.5 if "waves" in law else 20.0)
    (finding,) = [each for each in found.findings if LEFT in each.title and law in each.title]
    assert finding.severity == "warning"
    assert "% smaller" in finding.why
    assert finding.why.startswith(f"{own[0].number:.3g} {own[0].unit};" if own[0].unit else "root")
    assert len(finding.title.split()) <= 8
    assert len(finding.brief) <= 2 * 80 - len("warning: ")
    assert finding.do in finding.brief
    assert "as parameters" not in str(found.verdict)


def test_what_is_left_of_a_delay_is_no_missing_force(robot, model):
    motion = wander(robot, 4, 20.0, 50.0, size=(0.5, 0.5))
    plain, late = record(robot, motion, None, scaled_bodies(robot, 0.2), 0.01), 0.01
    force = np.stack([np.interp(motion.time - late, motion.time, own) for own in plain.force.T], 1)
    read = unchecked(motion.time, np.zeros_like(force), force, robot.actuated)
    runs = [replace(plain, force=force, log=read)]
    fit = working_fit(loopid.identification.samples_of(model, runs))
    none, ends = np.zeros(2), np.full((2, 2), np.inf)
    left = Delay(robot.actuated, 0.0, (-np.inf, np.inf), none, ends, 0.02, none, np.array([late]))
    certain = [
        {each.certainty for each in missing_forces(fit, model, runs, delay)}
        for delay in (None, left)
    ]
    assert ["clear" in each for each in certain] == [True, False]


def test_what_advice_prints_takes_the_spring_away(robot, with_law):
    found = with_law("grows with position")
    finding = next(each for each in found.findings if "grows with position" in each.title)
    terms = finding.do.split('terms="')[1].split('"')[0]
    again = identify_unjudged(
        loopid.force_model(robot, "full", terms), run(robot, LAWS["grows with position"])
    )
    assert not clear(again)
    assert again.fit[f"{LEFT}.Ks"].value == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize(
    ("terms", "law"), [("Fc=0.05,Fv=0.1", f"motion of {RIGHT}"), ("Ks=2", "position")]
)
def test_what_advice_prints_for_passive_joints_takes_their_forces_away(robot, model, terms, law):
    """In a loop the motors feel what rubs, or is sprung, at joints that have none."""
    motion = wander(robot, 4, 20.0, 50.0, size=(0.5, 0.5))
    true = JointTerms.with_values(robot, f"Fc=0.1,Fv=0.05; passive: {terms}")
    log = record(robot, motion, true, scaled_bodies(robot, 0.2), 0.01)
    before = identify_unjudged(model, log)
    finding = next(each for each in before.findings if law in each.title)
    advised = finding.do.split('terms="')[-1].split('"')[0]
    assert advised.startswith("auto; passive: ")
    after = identify_unjudged(loopid.force_model(robot, "full", advised), log)
    assert not clear(after)
    assert after.verdict.error < 0.5 * before.verdict.error


def test_a_spring_that_moves_estimates_and_hardly_any_error_is_named(robot, model):
    spring = run(robot, lambda t, q, v, a: q - q.mean())
    (own,) = clear(identify_unjudged(model, spring))
    assert own.law == "grows with position"
    assert own.left > 0.9
    assert own.moved > 10
    assert "standard errors" in own.effect


def off(found, robot):
    """Errors of the estimates of bodies that are known well, in standard errors."""
    base, fit = found.force_model.base, found.fit
    labels = robot.parameters("full").labels
    known = dict(zip(labels, scaled_bodies(robot, 0.2), strict=True))
    true = base.values(np.array([known.get(one, 0.0) for one in base.parameters.labels]))
    bodies = [k for k, each in enumerate(fit.parameters) if each.kind in KINDS]
    return (np.abs(fit.values - true) / fit.standard_errors)[bodies]


def test_intervals_hold_a_spring_that_is_likely_but_not_clear(robot, model):
    found = identify_unjudged(model, run(robot, lambda t, q, v, a: 0.8 * (q - q.mean())))
    assert not clear(found)
    (spring,) = [each for each in found.missing if each.certainty == "likely"]
    assert spring.law == "grows with position"
    assert any(each.title == f"perhaps a spring at {spring.motor}" for each in found.findings)
    assert off(found, robot).max() < 2.5
    plain = found["consistent"].fit.covariance - np.outer(spring.bias, spring.bias)
    assert (np.sqrt(np.diag(plain)) < found.fit.standard_errors / 10).any()


def test_a_spring_that_would_not_show_is_said_with_its_size(robot, model, with_law):
    found = with_law()
    hidden = [each for each in found.missing if each.certainty == "hidden"]
    (one,) = [each for each in found.findings if "may hide a spring" in each.title]
    assert one.severity == "note"
    assert f"{hidden[0].number:.3g} N m/rad" in one.why
    # One of half that size does not show, and moves an estimate by more than its interval.
    spring = run(robot, lambda t, q, v, a: hidden[0].number / 2 * (q - q.mean()))
    again = identify_unjudged(model, spring)
    assert not [each for each in again.missing if each.certainty != "hidden"]
    assert off(again, robot).max() > 3


def longer(robot, part):
    """The robot whose left coupler is so much longer than its file says."""
    model = robot.model.copy()
    place = model.frames[model.getFrameId("left_coupler_end")].placement
    place.translation = (1 + part) * place.translation
    other = replace(robot, model=model)
    return replace(other, reference=closed_nearby(robot, other, robot.reference[None])[0])


def as_in_the_file(robot, motion, zero=0.0):
    """The motion of a robot's motors, as its file closes the loops; the first from another zero."""
    q = motion.configurations[:, [robot.joint(name).idx_q for name in robot.actuated]]
    signals = q + np.array([zero, 0.0]), motion.velocities, motion.accelerations
    return joint_motion(robot, Motion(robot.actuated, motion.time, *signals))


def test_a_length_that_is_off_is_named(robot):
    model = loopid.force_model(robot, "full")
    true = run(longer(robot, 0.02))
    motion = true.motion
    there = as_in_the_file(robot, motion)
    found = identify_unjudged(model, Recording.of_motion(there, true.force, robot.actuated))
    (length,) = clear(found)
    assert not length.motor
    assert 0.005 < abs(length.number) < 0.04
    assert any("lengths of the robot file" in each.title for each in found.findings)
    assert "as parameters" not in str(found.verdict)


def test_intervals_hold_a_length_that_is_off_by_less_than_is_clear(robot, model):
    true = run(longer(robot, 0.0018))
    there = as_in_the_file(robot, true.motion)
    found = identify_unjudged(model, Recording.of_motion(there, true.force, robot.actuated))
    (length,) = [each for each in found.missing if each.certainty == "likely"]
    assert not length.motor
    assert any("are perhaps off" in each.title for each in found.findings)
    assert off(found, robot).max() < 2.5
    plain = found["consistent"].fit.covariance - np.outer(length.bias, length.bias)
    assert (np.sqrt(np.diag(plain)) < found.fit.standard_errors / 2).any()


@pytest.mark.validate
def test_a_length_that_is_off_by_less_than_links_are_made_to_is_not_named(robot, model):
    true = run(longer(robot, 4e-5), noise=1e-6)
    there = as_in_the_file(robot, true.motion)
    found = identify_unjudged(model, Recording.of_motion(there, true.force, robot.actuated))
    assert not any("length" in each.title for each in found.findings)
    (length,) = (each for each in found.missing if not each.motor)
    assert 1e-5 < abs(length.number) < 5e-5
    plain = found.fit.covariance - np.outer(length.bias, length.bias)
    assert (np.sqrt(np.diag(plain)) < found.fit.standard_errors / 2).any()  # intervals hold it


@pytest.mark.parametrize("larger", [1.0, 3.0])
def test_lengths_are_not_found_by_errors_around_reversals(larger):
    time = np.arange(0.0, 20.0, 0.02)
    rates = np.stack([np.cos(time), np.cos(1.3 * time)], axis=1)
    errors = np.random.default_rng(0).normal(size=rates.shape)
    errors[np.abs(rates[:, 0]) < 0.2, 0] *= larger
    samples = SimpleNamespace(used=np.abs(rates) > 0.02, residual=lambda values: errors)
    fit = SimpleNamespace(samples=samples, result=SimpleNamespace(values=None))
    left_out = _slow(fit, [SimpleNamespace(motion=SimpleNamespace(velocities=rates))])
    assert left_out.any() == (larger > 1)
    assert not left_out[np.abs(rates) > 0.5].any()
    assert not left_out[~samples.used].any()
    assert (np.abs(rates[samples.used & ~left_out]) > 0.2).all() == (larger > 1)


def test_forces_of_a_length_are_those_of_a_robot_with_that_length(robot, model):
    other = longer(robot, 0.001)
    motion = wander(other, 4, 5.0, 20.0, size=(0.5, 0.5))
    there = as_in_the_file(robot, motion)
    force = record(other, motion, noise=0.0).force - record(robot, there, noise=0.0).force
    still = Recording.of_motion(there, np.zeros_like(force), robot.actuated)
    found = length_forces(model, model.standard_prior, [still])[Place("left_coupler_end")]
    np.testing.assert_allclose(0.001 * found, force, atol=0.02 * np.abs(force).max())


def test_forces_of_a_zero_are_those_at_positions_that_are_less(robot, model):
    motion = wander(robot, 4, 5.0, 20.0, size=(0.5, 0.5))
    there = as_in_the_file(robot, motion, 1e-3)
    force = record(robot, motion, noise=0.0).force - record(robot, there, noise=0.0).force
    still = Recording.of_motion(there, np.zeros_like(force), robot.actuated)
    found = length_forces(model, model.standard_prior, [still])[Place(LEFT, "rad")]
    np.testing.assert_allclose(1e-3 * found, force, atol=0.02 * np.abs(force).max())


@pytest.mark.parametrize("zero", few_of([0.02, -0.05], 0.02))
def test_a_zero_that_is_off_is_named_and_what_to_set(robot, model, zero):
    true = run(robot)
    there = as_in_the_file(robot, true.motion, zero)
    found = identify_unjudged(model, Recording.of_motion(there, true.force, robot.actuated))
    one = clear(found)[0]
    assert one.zero
    assert one.number == pytest.approx(zero, rel=0.25)  # Gauss-Newton's first step
    said = found.findings[0]
    assert said.title == f"zero of {LEFT} is off"
    assert said.do == found.verdict.improvement
    assert f"{{{LEFT}: {-one.number:.3g}}}" in said.do
    assert "as parameters" not in str(found.verdict)


@pytest.mark.parametrize(("scale", "named"), [(1.0, True), (0.01, False)])
def test_a_zero_is_no_further_off_than_its_forces_are_linear(
    robot, model, monkeypatch, scale, named
):
    """Forces that would need two radians, each of which makes a hundredth of the real force."""

    def weak(*given):
        return {Place(LEFT, "rad"): scale * length_forces(*given)[Place(LEFT, "rad")]}

    monkeypatch.setattr(missing, "length_forces", weak)
    true = run(robot)
    there = as_in_the_file(robot, true.motion, 0.02)
    found = identify_unjudged(model, Recording.of_motion(there, true.force, robot.actuated))
    assert any(each.zero for each in found.missing) == named


@pytest.mark.parametrize("times", [0.5, 1.0, 4.0])
def test_a_coupling_is_as_clear_as_it_stands_out_from_those_of_other_motors(times):
    """Where all look this many times larger than by chance, so does one that is none."""
    motors, degrees = ("a", "b", "c", "d"), 3
    usual = float(chdtrc(degrees, times * chdtri(degrees, 0.5)))
    couplings = {
        pair: SimpleNamespace(chance=usual if set(pair) == {"c", "d"} else 0.0)
        for pair in permutations(motors, 2)
    }
    search = SimpleNamespace(motors=motors, couplings=couplings)
    chance = _Search._beside_others(search, "a", "b", float(chdtrc(degrees, times * 20.0)))
    assert chdtri(degrees, chance) == pytest.approx(20.0 * min(times, 1.0))


def test_two_motors_have_no_others_that_a_coupling_is_measured_by():
    clear = SimpleNamespace(chance=1e-9)
    search = SimpleNamespace(motors=("a", "b"), couplings={("a", "b"): clear, ("b", "a"): clear})
    assert _Search._beside_others(search, "a", "b", 1e-9) == 1e-9


@pytest.mark.parametrize(("left", "named"), [(0.5, True), (0.95, False)])
def test_what_follows_another_motor_saves_errors_left_out(robot, model, monkeypatch, left, named):
    """However far it moves estimates; of other laws that is enough."""
    monkeypatch.setattr(_Test, "left", lambda *_: left)
    law = f"follows the motion of {RIGHT}"
    found = identify_unjudged(model, run(robot, LAWS[law]))
    assert any(each.law == law for each in found.missing) == named
    spring = identify_unjudged(model, run(robot, LAWS["grows with position"]))
    assert any(each.law == "grows with position" for each in spring.missing)


def test_what_saves_errors_saves_them_where_states_are_left_out_too(robot, model):
    """Where all segments have the same states, they alone would praise whatever joins these."""
    recording, states = run(robot), np.random.default_rng(0).normal(size=8)
    of_each = np.arange(len(recording)) % len(states)
    force, columns = recording.force.copy(), np.zeros((len(recording), 2, 6))
    force[:, 0] += states[of_each]
    columns[:, 0] = np.linspace(-1, 1, 8)[of_each, None] ** np.arange(1, 7)
    samples = loopid.identification.samples_of(model, [replace(recording, force=force)])
    segments, both = (
        _Test(working_fit(replace(samples, regions=regions)), len(model.parameters)).left(columns)
        for regions in (0 * of_each, of_each)
    )
    assert segments < 0.5
    assert both > 1.0


@pytest.mark.parametrize("seed", few_of(range(3), 0))
def test_nothing_is_missing_where_nothing_is(robot, model, with_law, seed):
    found = identify_unjudged(model, run(robot, seed=seed)) if seed else with_law()
    assert all(each.certainty == "hidden" for each in found.missing)
    assert "as parameters of the robot" in str(found.verdict)


def test_intervals_hold_the_bias_of_a_force_that_is_missing(with_law):
    found = with_law("drifts in time")
    for each in found.missing:
        assert (found["consistent"].fit.standard_errors >= 0.99 * np.abs(each.bias)).all()


# Noise of the sensors.


@pytest.fixture(scope="module")
def logs(robot):
    """A log whose force is a slow wave with white noise of 0.1 N m, and one that was filtered."""
    time = np.arange(0, 40, 0.005)
    position = robot.reference[[robot.joint(name).idx_q for name in robot.actuated]]
    position = position + 0.2 * np.sin(time[:, None] * [1.0, 1.3])
    noise = 0.1 * np.random.default_rng(0).normal(size=position.shape)
    force = 3 * np.sin(time[:, None]) + noise
    filtered = LowPass(20.0).apply(force, 200.0)
    return [unchecked(time, position, each, robot.actuated) for each in (force, filtered)]


def test_noise_of_sensors_is_what_the_filter_leaves_of_it(robot, logs):
    recording = quietly(loopid.prepare, robot, logs[0])
    noise = 0.1 * np.random.default_rng(1).normal(size=(20000, 2))
    left = LowPass(recording.cutoff).apply(noise, 200.0).std(axis=0)
    np.testing.assert_allclose(sensor_noise(recording), left, rtol=0.1)


def test_of_filtered_forces_noise_is_not_told(robot, logs):
    assert np.isnan(sensor_noise(quietly(loopid.prepare, robot, logs[1]))).all()
    assert np.isnan(sensor_noise(run(robot))).all()  # without a log
