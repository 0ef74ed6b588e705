"""A payload from runs without and with it."""

from pathlib import Path

import numpy as np
import pytest

import loopid
from loopid.diagnosis.payload import MotorMasses
from loopid.logs import Recording
from loopid.motion import JointMotion
from made_runs import quietly

MASS, CENTRE = 6.0, np.array([0.04, -0.02, 0.05])
FRICTION = np.tile([60.0, 900.0], 4)


@pytest.fixture(scope="module")
def case(knee):
    """The knee robot, its gravity model, a slow motion, and forces with a load on its platform."""
    terms = loopid.JointTerms(knee.actuated, ("Fc", "Fv"))
    model = loopid.force_model(knee, "gravity", terms)
    plan = loopid.motion.read_motion_program("3ups_rpu").motion("9", 2)
    moved = loopid.motion.joint_motion(knee, plan)
    q, v, a = moved.configurations, moved.velocities, 0 * moved.accelerations
    motion = JointMotion(moved.time, q, v, a, moved.singularity)
    bodies = knee.standard_parameters("full")
    first = knee.parameters("full").labels.index("platform.m")

    def force(mass, centre):
        carried = bodies.copy()
        carried[first : first + 4] += mass, *(mass * centre)
        standard = np.concatenate([of_gravity(knee, carried), FRICTION])
        return model.standard_regressor(q, v, a) @ standard

    return knee, model, motion, force


def of_gravity(knee, bodies):
    labels = knee.parameters("full").labels
    return bodies[[labels.index(label) for label in knee.parameters("gravity").labels]]


def recorded(knee, motion, force):
    return Recording.of_motion(motion, force, knee.actuated)


def noisy_runs(case, rng, mass, centre, gains=1.0):
    knee, _, motion, force = case
    forces = force(0.0, centre), force(mass, centre)
    return [
        [recorded(knee, motion, (each + rng.normal(scale=2.0, size=each.shape)) / gains)]
        for each in forces
    ]


def test_a_payload_without_noise_is_found_to_round_off(case):
    knee, model, motion, force = case
    runs = [recorded(knee, motion, force(mass, CENTRE)) for mass in (0.0, MASS)]
    found = loopid.identify_payload(
        model, link="platform", unloaded=runs[:1], loaded=runs[1:], estimator="ols"
    )
    assert found.parameters.labels == ("payload.m", "payload.mx", "payload.my", "payload.mz")
    assert found.mass == pytest.approx(MASS, rel=1e-7)
    np.testing.assert_allclose(found.centre()[0], CENTRE, atol=1e-8)


@pytest.mark.validate
def test_paths_and_a_robot_are_taken_as_recordings_and_a_model(load_once, tmp_path):
    robot, path = load_once("five_bar"), tmp_path / "run.csv"
    rows = Path("urdf/logs/five_bar.csv").read_text().splitlines()
    path.write_text("\n".join([rows[0], *rows[200:700], ""]))
    log, part = (loopid.read_log(path, robot, rows=rows) for rows in (None, (1, 400)))
    model = loopid.force_model(robot, "full")
    light, heavy = (quietly(loopid.prepare, robot, each) for each in (log, part))
    options = {"link": "right_coupler", "estimator": "ols"}
    found = quietly(loopid.identify_payload, robot, path, part, **options)
    assert found == quietly(loopid.identify_payload, model, [light], [heavy], **options)


@pytest.mark.validate
@pytest.mark.filterwarnings("ignore::loopid.errors.DataWarning")  # of the robot's own bodies
def test_intervals_hold_at_their_rate(case):
    rng, runs = np.random.default_rng(0), 500
    hits = np.zeros(7)
    for _ in range(runs):
        mass, centre = rng.uniform(1, 20), rng.uniform(-0.1, 0.1, 3)
        light, heavy = noisy_runs(case, rng, mass, centre)
        found = loopid.identify_payload(case[1], link="platform", unloaded=light, loaded=heavy)
        truth = np.concatenate([[mass], mass * centre, centre])
        low, high = np.concatenate([found.intervals(), found.centre()[1]]).T
        hits += (low < truth) & (truth < high)
    assert (hits / runs).min() > 0.92
    assert (hits / runs).max() < 0.99


@pytest.mark.filterwarnings("ignore::loopid.errors.DataWarning")
def test_intervals_of_one_noisy_case_are_of_the_size_of_the_errors(case):
    light, heavy = noisy_runs(case, np.random.default_rng(1), MASS, CENTRE)
    found = loopid.identify_payload(case[1], link="platform", unloaded=light, loaded=heavy)
    assert abs(found.mass - MASS) < 0.1 * MASS
    reach = np.ptp(found.intervals(), axis=1) / 2
    np.testing.assert_array_less(np.abs(found.values - [MASS, *(MASS * CENTRE)]), 2.5 * reach)


def test_what_makes_no_sense_is_refused(case):
    knee, model, motion, force = case
    run = [recorded(knee, motion, force(0.0, CENTRE))]
    with pytest.raises(loopid.LoopidError, match="unknown body 'arm'"):
        loopid.identify_payload(model, link="arm", unloaded=run, loaded=run)
    with pytest.raises(loopid.LoopidError, match="recordings without it, and others with it"):
        loopid.identify_payload(model, link="platform", unloaded=run, loaded=[])


@pytest.mark.filterwarnings("ignore::loopid.errors.DataWarning")
def test_exchanged_logs_are_no_payload_of_nothing(case):
    light, heavy = noisy_runs(case, np.random.default_rng(1), MASS, CENTRE)
    with pytest.raises(loopid.errors.DataError, match="may be exchanged") as refused:
        loopid.identify_payload(case[1], link="platform", unloaded=heavy, loaded=light)
    assert refused.value.facts["value"] == pytest.approx(-MASS, rel=0.1)


def test_motors_with_other_gains_disagree_and_the_interval_holds_it(case):
    gains = np.array([0.9, 1.1, 1.0, 1.05])
    light, heavy = noisy_runs(case, np.random.default_rng(2), 20.0, CENTRE, gains)
    with pytest.warns(loopid.errors.DataWarning, match="motors disagree on the mass: "):
        found = loopid.identify_payload(case[1], link="platform", unloaded=light, loaded=heavy)
    motors = found.motors
    assert motors.undetermined == ()
    low, high = motors.intervals(0.999).T
    assert ((low < 20.0 / gains) & (20.0 / gains < high)).all()
    low, high = found.intervals()[0]
    assert high - low > motors.values.max() - motors.values.min()


def masses(values, error):
    values = np.array(values)
    names = tuple(f"motor{k}" for k in range(len(values)))
    return MotorMasses(names, values, error**2 * np.eye(len(values)), 50.0, ())


def test_what_motors_differ_by_beyond_their_errors():
    values = [2.0, 2.2, 2.5, 2.9]
    assert masses(values, 1e-6).spread == pytest.approx(np.std(values, ddof=1), rel=1e-3)
    assert masses(values, 1.0).spread == 0.0
    assert masses(values, 1.0).disagreement is None
    assert "2 kg by motor0, 2.9 kg by motor3" in masses(values, 0.05).disagreement.why
    assert masses([2.0], 1e-6).chance == 1.0
    # What is left after the spread is as large as expected.
    one = masses(values, 0.2)
    assert one._square(one.spread) == pytest.approx(3.0)


def test_one_payload_in_a_hundred_disagrees_by_chance():
    rng = np.random.default_rng(0)
    said = [bool(masses(rng.normal(2.0, 0.1, 5), 0.1).disagreement) for _ in range(2000)]
    assert np.mean(said) < 0.015
