"""Simulated measurements: the model's forces, plus errors of the stated kind and size."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import Dynamics, JointTerms, random_configurations
from loopid.errors import DataError, OptionError
from loopid.kinematics import (
    closed_motion,
    measured_coordinates,
    platform_coordinates,
    project,
    random_motions,
)
from loopid.motion import FourierSeries, JointMotion, Noise, Waypoint, joint_motion, point_to_point
from loopid.regressors import motion_regressor


@pytest.fixture(scope="module")
def motion(load_once):
    knee = load_once("3ups_rpu")
    start = platform_coordinates(knee, knee.reference[None])[0]
    ways = [Waypoint(start + np.array([0.05, 0.03, 0.2, -0.2]), 5.0), Waypoint(start, 5.0)]
    return joint_motion(knee, point_to_point(knee.platform.names, start, ways, rate=100.0))


def test_without_noise_forces_are_those_of_the_model(knee, motion):
    q, v, a = motion.configurations, motion.velocities, motion.accelerations
    pi = np.random.default_rng(0).normal(size=len(knee.parameters()))
    measured = loopid.simulate(knee, motion, standard_parameters=pi)
    expected = motion_regressor(knee, closed_motion(knee, q, v, a)) @ pi
    np.testing.assert_allclose(measured.force, expected, atol=1e-9)
    np.testing.assert_array_equal(measured.force, measured.exact_force)
    read = measured_coordinates(knee).read(motion.configurations.copy())
    np.testing.assert_array_equal(measured.position, read)


def test_friction_opposes_the_motion_of_its_own_motor(knee, motion):
    terms = JointTerms(knee.actuated, ("Fc", "Fv"))
    values = np.array([17.0, 300.0, 22.0, 300.0, 19.0, 300.0, 230.0, 2000.0])
    bare = loopid.simulate(knee, motion)
    with_friction = loopid.simulate(knee, motion, joint_terms=terms, joint_values=values)
    rates = motion.velocities
    expected = values[::2] * np.sign(rates) + values[1::2] * rates
    np.testing.assert_allclose(with_friction.force - bare.force, expected, atol=1e-9)


def test_a_motor_that_stands_carries_its_load_alone(knee):
    """The sign of a rounding error is no friction; a motor that moves has its own."""
    motors = knee.velocity_indices(knee.actuated)
    start = np.array([knee.reference[knee.joint(name).idx_q] for name in knee.actuated])
    sines = np.array([[0.01], [0.0], [0.0], [0.0]])
    series = FourierSeries(knee.actuated, 0.5, start, sines, 0 * sines)
    motion = joint_motion(knee, series.motion(rate=50))
    shaken = 1e-14 * np.random.default_rng(0).normal(size=motion.velocities.shape)
    motion = replace(motion, velocities=motion.velocities + shaken)
    terms, values = JointTerms(knee.actuated, ("Fc",)), np.full(len(motors), 60.0)
    plain = loopid.simulate(knee, motion)
    rubbed = loopid.simulate(knee, motion, joint_terms=terms, joint_values=values)
    friction = rubbed.force - plain.force
    np.testing.assert_allclose(friction[:, 1:], 0.0, atol=1e-9)
    assert (np.abs(np.abs(friction[:, 0]) - 60.0) < 1e-6).mean() > 0.9


def test_noise_has_the_stated_size_and_no_bias(knee, motion):
    errors = {
        kind: loopid.simulate(knee, motion, Noise(**{kind: 12.0}))
        for kind in ("uniform", "gaussian")
    }
    for kind, deviation in (("uniform", 12 / np.sqrt(3)), ("gaussian", 12.0)):
        error = errors[kind].force - errors[kind].exact_force
        assert error.std() == pytest.approx(deviation, rel=0.05)
        assert abs(error.mean()) < 4 * deviation / np.sqrt(error.size)
    assert np.abs(errors["uniform"].force - errors["uniform"].exact_force).max() <= 12.0


def test_encoders_read_whole_steps(knee, motion):
    step = 2e-5
    read = loopid.simulate(knee, motion, Noise(encoder_step=step)).position
    exact = loopid.simulate(knee, motion).position
    np.testing.assert_allclose(read / step, np.round(read / step), atol=1e-6)
    assert np.abs(read - exact).max() <= step / 2 * (1 + 1e-9)


def test_a_seed_repeats_the_errors_and_another_does_not(knee, motion):
    one, same, other = (
        loopid.simulate(knee, motion, Noise(12.0, 1.0), seed=seed).force for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one, same)
    assert (one != other).all()


@pytest.mark.parametrize(
    ("arguments", "failure", "word"),
    [
        ({"joint_values": np.ones(8)}, OptionError, "go together"),
        ({"joint_terms": JointTerms(("leg1_stroke",))}, OptionError, "go together"),
        (
            {"joint_terms": JointTerms(("leg1_stroke",)), "joint_values": np.ones(3)},
            DataError,
            "leg1_stroke.Fc",
        ),
        ({"standard_parameters": np.ones(3)}, DataError, "standard parameters"),
        ({"seed": -1}, OptionError, "seed"),
    ],
)
def test_wrong_input_is_refused(knee, motion, arguments, failure, word):
    with pytest.raises(failure, match=word):
        loopid.simulate(knee, motion, **arguments)


@pytest.mark.parametrize("name", ["uniform", "gaussian", "encoder_step"])
def test_noise_is_never_negative(name):
    with pytest.raises(OptionError, match=name):
        Noise(**{name: -1.0})


@pytest.fixture(scope="module")
def swing(linkage):
    """The five-bar with three motors, and a motion of it."""
    robot = linkage("redundant five-bar")
    centre = robot.reference[robot.velocity_indices(robot.independent)]
    ways = [Waypoint(centre + np.array([0.2, -0.1]), 1.0), Waypoint(centre, 1.0)]
    return robot, joint_motion(robot, point_to_point(robot.independent, centre, ways, rate=20.0))


def test_redundant_motors_share_what_two_would_do(swing, linkage):
    robot, motion = swing
    measured, alone = (loopid.simulate(each, motion) for each in (robot, linkage("five-bar")))
    rates = closed_motion(robot, motion.configurations, motion.velocities, motion.accelerations)
    motors = robot.velocity_indices(robot.actuated)
    # The same power, and more generally the same work in any motion.
    shares = rates.projection.G[:, motors]
    np.testing.assert_allclose(
        np.einsum("nmi,nm->ni", shares, measured.force), alone.force, atol=1e-9
    )
    joints = [robot.joint(name).idx_q for name in robot.actuated]
    np.testing.assert_array_equal(measured.position, motion.configurations[:, joints])


def test_redundant_motors_share_with_the_least_squares(swing):
    robot, motion = swing
    force = loopid.simulate(robot, motion).force
    G = project(robot, motion.configurations).G[:, robot.velocity_indices(robot.actuated)]
    # Along the one way in which three motors can work against each other without moving.
    idle = np.linalg.svd(G.transpose(0, 2, 1))[2][:, -1]
    np.testing.assert_allclose((idle * force).sum(axis=1), 0, atol=1e-9)


def falling(robot, forces):
    """Unrelated samples of what a robot does under forces of its motors."""
    q = random_configurations(robot, len(forces), seed=1)
    rates, _ = random_motions(robot, len(forces), seed=2)
    dynamics, none = Dynamics(robot), np.zeros((len(q), len(robot.free)))
    accelerations = dynamics.forward(dynamics.pose(q=q), rates, np.hstack([forces, none]))
    return JointMotion(np.arange(len(q)) / 10, q, rates, accelerations, np.ones(len(q)))


@pytest.mark.parametrize("size", [0.0, 5.0])
def test_motors_of_a_robot_with_a_free_rod_measure_what_they_do(linkage, size):
    robot = linkage("ball rssr")
    forces = size * np.random.default_rng(3).normal(size=(20, 1))
    measured = loopid.simulate(robot, falling(robot, forces))
    np.testing.assert_allclose(measured.force, forces, atol=1e-9)
    assert measured.position.shape == (20, 1)


def test_a_motion_that_no_motor_can_give_is_refused(linkage):
    robot = linkage("ball rssr")
    motion = falling(robot, np.zeros((20, 1)))
    pushed = replace(motion, accelerations=motion.accelerations + np.array([0.0, 0.1]))
    with pytest.raises(DataError, match=r"leave ball\.wx free.*Dynamics\.forward"):
        loopid.simulate(robot, pushed)


def test_what_is_simulated_is_data_as_it_is_and_as_a_file(tmp_path, load_once):
    robot = load_once("five_bar")
    sizes, phases = [[0.08, 0.04], [0.04, 0.08]], [[0.1, 0.0], [0.0, 0.1]]
    series = FourierSeries(robot.actuated, 0.5, [2.0, 0.8], sizes, phases)
    noise, moved = Noise(gaussian=0.01), series.motion(rate=100)
    measured = loopid.simulate(robot, moved, noise, seed=1)
    assert measured == loopid.simulate(robot, joint_motion(robot, moved), noise, seed=1)
    file = measured.save(tmp_path / "run.csv")
    assert file.read_text().splitlines()[0].split(",") == measured.to_polars().columns
    read = loopid.read_log(file, robot)
    np.testing.assert_allclose(read.force, measured.force, rtol=1e-8)
    model = loopid.force_model(robot, "gravity", "Fc")
    fit = loopid.Fit.of(model, model.prior)
    one, other = (fit.predict(data).recording for data in (measured, file))
    np.testing.assert_allclose(one.force, other.force, rtol=1e-6)
    with pytest.raises(OptionError, match=r"unknown ending '\.txt' of"):
        measured.save(tmp_path / "run.txt")
