"""More motors than degrees of freedom: friction of all of them, and the bodies, are found."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import JointTerms
from loopid.errors import DataError
from loopid.identification import identify
from loopid.identification.fitting import quiet_fit
from loopid.identification.verdict import _doubtful
from loopid.kinematics import closed_motion
from loopid.logs import Log, Recording, read_log
from made_runs import logged, quietly, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")

FRICTION = np.array([0.3, 0.4, 0.2, 0.5, 0.25, 0.3])
NOISE = 0.05
DRAWS = 16
WRONG_SIGN = "look for a wrong sign, scale or length of the robot file, or exchanged columns"


@pytest.fixture(scope="module")
def robot(linkage):
    return linkage("redundant five-bar")


@pytest.fixture(scope="module")
def model(robot):
    return loopid.force_model(robot, "full", JointTerms(robot.actuated))


@pytest.fixture(scope="module")
def motion(robot):
    return run_of(robot, 1)


def run_of(robot, seed):
    # Its motors are not the coordinates of the motion: two of them are.
    return wander(robot, seed, seconds=40.0, rate=50.0, size=(0.4, 0.4))


@pytest.fixture(scope="module")
def truth(robot, model):
    return model.base.values(np.concatenate([robot.standard_parameters(), FRICTION]))


def test_terms_of_all_motors_do_their_work_in_any_motion(robot, motion):
    terms = JointTerms(robot.actuated, ("Ia", "Fc", "Fv", "Fo"))
    whole = closed_motion(robot, motion.configurations, motion.velocities, motion.accelerations)
    values = np.random.default_rng(2).uniform(1, 2, size=12).reshape(3, 4)
    rates, pushes = (
        each[:, robot.velocity_indices(robot.actuated)]
        for each in (whole.velocities, whole.accelerations)
    )
    inertia, coulomb, viscous, offset = values.T
    forces = inertia * pushes + coulomb * np.sign(rates) + viscous * rates + offset
    found = terms.columns(robot, whole) @ values.ravel()
    np.testing.assert_allclose(
        (found * motion.velocities).sum(axis=1), (forces * rates).sum(axis=1), atol=1e-9
    )


def test_friction_of_every_motor_can_be_told(model, robot):
    labels = set(model.parameters.labels)
    assert {f"{joint}.{kind}" for joint in robot.actuated for kind in ("Fc", "Fv")} <= labels


def test_what_each_motor_measures_tells_the_truth(robot, model, motion, truth):
    terms = JointTerms(robot.actuated)
    exact = loopid.simulate(robot, motion, joint_terms=terms, joint_values=FRICTION)
    q, shape = motion.configurations, exact.force.shape
    still = np.zeros_like(motion.velocities)
    G = closed_motion(robot, q, still, still).projection.G[
        :, robot.velocity_indices(robot.actuated)
    ]
    forces, errors = np.einsum("nmi,nm->ni", G, exact.force), []
    samples = model.samples(Recording.of_motion(motion, forces, robot.independent))
    generator = np.random.default_rng(5)
    for _ in range(DRAWS):
        noise = np.einsum("nmi,nm->ni", G, generator.normal(scale=NOISE, size=shape))
        fit = quiet_fit(samples.with_force(forces + noise))
        errors.append((fit.values - truth) / fit.standard_errors)
    assert np.abs(np.mean(errors, axis=0)).max() < 4 / np.sqrt(DRAWS)
    # Noise of a shared motor is in both rows and differs with the pose: nearly what is stated.
    assert 0.8 < np.std(errors) < 1.25


@pytest.fixture(scope="module")
def found(robot, model, tmp_path_factory, once):
    """Identification from logs on disk, of motors without redundant ones telling more."""

    def identified():
        folder, terms = tmp_path_factory.mktemp("logs"), (JointTerms(robot.actuated), FRICTION)
        recordings = []
        for seed in (1, 2):
            path = folder / f"{seed}.csv"
            path.write_text(logged(robot, run_of(robot, seed), terms, noise=NOISE, seed=seed))
            recordings.append([quietly(loopid.prepare, robot, quietly(read_log, path, robot))])
        return quietly(identify, model, recordings[0], validation=recordings[1])

    return once("redundant motors", identified)


def test_logs_of_all_motors_give_bodies_and_friction(found, model, truth):
    assert [part.actuators for part in found.training] == [model.robot.independent]
    fresh = found.new.regressor
    expected = fresh @ truth
    off = found["all parameters"].fit.forces(fresh) - expected
    assert np.sqrt((off**2).mean()) < 0.02 * np.sqrt((expected**2).mean())
    joints = model.joint_columns
    np.testing.assert_allclose(found["all parameters"].fit.values[joints], truth[joints], atol=0.05)


def test_a_true_robot_file_is_confirmed(found):
    assert not any(candidate.beats_baseline for candidate in found.candidates.values())
    assert min(found.baseline.validation.r_squared) > 0.98


# Encoders of redundant motors against the loops


@pytest.fixture(scope="module")
def run(robot):
    """Arrays of a log: time, positions and forces of all motors."""
    motion = wander(robot, 3, seconds=5.0, rate=50.0, size=(0.4, 0.4))
    run = loopid.simulate(robot, motion)
    return run.time, run.position, run.force


def heard(robot, run, position):
    log = Log.from_arrays(run[0], position, run[2], robot.actuated)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        loopid.prepare(robot, log)
    return [str(w.message) for w in said if "redundant motor" in str(w.message)]


def changed(robot, run, change):
    (name,) = robot.redundant
    position = np.array(run[1])
    position[:, robot.actuated.index(name)] = change(position[:, robot.actuated.index(name)])
    return position


def test_an_encoder_that_agrees_with_the_loops_is_no_news(robot, run):
    assert heard(robot, run, run[1]) == []
    assert heard(robot, run, np.round(run[1] / 1e-3) * 1e-3) == []
    assert heard(robot, run, changed(robot, run, lambda q: q + 0.003)) == []


def test_a_zero_that_is_off_is_named_with_what_mends_it(robot, run):
    (said,) = heard(robot, run, changed(robot, run, lambda q: q + 0.5))
    assert robot.redundant[0] in said
    assert "by 0.5 rad all along" in said
    advised = float(re.search(r"add (\S+) to its positions", said)[1])
    assert heard(robot, run, changed(robot, run, lambda q: q + 0.5 + advised)) == []


def test_a_sign_or_scale_that_is_off_is_no_zero(robot, run):
    for change in (np.negative, lambda q: 1.2 * q):
        (said,) = heard(robot, run, changed(robot, run, change))
        assert WRONG_SIGN in said
        assert "all along" not in said


def test_parameters_are_not_praised_where_an_encoder_is_not_where_the_loops_put_it(robot, found):
    def elsewhere(run):
        position = changed(robot, (None, run.log.position), np.negative)
        return replace(run, log=replace(run.log, position=position))

    other = replace(found, training=tuple(map(elsewhere, found.training)))
    assert not _doubtful(found)
    assert _doubtful(other)
    said = [[each for each in one.findings if "redundant" in each.title] for one in (found, other)]
    assert not said[0]
    assert {(each.severity, each.do) for each in said[1]} == {("warning", WRONG_SIGN)}


@pytest.mark.parametrize("motor", ["left_joint", "left_elbow"])
def test_a_motor_without_force_spoils_the_rows_that_it_acts_on_and_does_move(robot, motion, motor):
    terms = JointTerms(robot.actuated)
    exact = loopid.simulate(robot, motion, joint_terms=terms, joint_values=FRICTION)
    silent = np.array([name == motor for name in robot.actuated])
    force = np.where(silent, 0.0, exact.force)
    log = Log.from_arrays(exact.time, exact.position, force, robot.actuated)
    if motor == "left_elbow":  # it works with both others
        with pytest.raises(DataError, match=r"as that of left_elbow, which works with the other"):
            quietly(identify, robot, log)
        return
    found = quietly(identify, robot, log)
    said = [each.title for each in found.findings]
    assert f"the force of {motor} is zero all along" in said
    assert not any("never moves" in title for title in said)
