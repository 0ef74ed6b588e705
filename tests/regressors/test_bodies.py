"""The regressor body by body is the projection of Pinocchio's tree regressor."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from loopid import closed_motion, dynamic_regressor, gravity_regressor, random_configurations
from loopid.kinematics import blocks, random_motions
from loopid.regressors import motion_regressor


def tree_columns(robot, q, v, a, model="full"):
    """Y (N, nv, n) by Pinocchio."""
    data, columns = robot.model.createData(), robot.columns(model)
    states = zip(q, v, a, strict=True)
    wholes = (pin.computeJointTorqueRegressor(robot.model, data, *state) for state in states)
    return np.array([whole.reshape(robot.model.nv, -1)[:, columns] for whole in wholes])


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_the_moving_one(moving):
    robot, q, rates, second = moving
    motion = closed_motion(robot, q, rates, second)
    Y = tree_columns(robot, q, motion.velocities, motion.accelerations)
    expected = np.einsum("nji,njk->nik", motion.projection.G, Y)
    close(dynamic_regressor(robot, q, rates, second), expected)
    close(motion_regressor(robot, motion), expected)


def test_the_resting_one(moving):
    robot, q, rates, second = moving
    motion, rest = closed_motion(robot, q, rates, second), np.zeros((len(q), robot.model.nv))
    Y = tree_columns(robot, q, rest, rest, "gravity")
    expected = np.einsum("nji,njk->nik", motion.projection.G, Y)
    close(gravity_regressor(robot, q), expected)
    close(motion_regressor(robot, motion, "gravity"), expected)


@pytest.mark.parametrize("away", [0.0, 1e4])
def test_where_the_robot_stands_costs_no_digits(knee, away):
    q = random_configurations(knee, 3, seed=0)
    rates, second = random_motions(knee, 3, seed=0)
    model = knee.model.copy()
    for k in range(1, model.njoints):
        if model.parents[k] == 0:
            model.jointPlacements[k].translation += away * np.array([1.0, -2.0, 3.0])
    moved = replace(knee, model=model)
    expected = dynamic_regressor(knee, q, rates, second)
    found = dynamic_regressor(moved, q, rates, second)
    # Only the closures, which compare places in the fixed frame, feel the distance.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_samples_do_not_depend_on_their_neighbours(knee, monkeypatch):
    q = random_configurations(knee, 60, seed=1)
    motion = random_motions(knee, 60, seed=1)
    whole = dynamic_regressor(knee, q, *motion)
    for fewest, most in ((7, 7), (50, 50), (1, 1)):
        monkeypatch.setattr(blocks, "FEWEST", fewest)
        monkeypatch.setattr(blocks, "MOST", most)
        close(dynamic_regressor(knee, q, *motion), whole)


def test_no_samples_give_no_rows(knee):
    none = np.empty((0, 4))
    assert dynamic_regressor(knee, np.empty((0, knee.model.nq)), none, none).shape == (0, 4, 90)
    assert gravity_regressor(knee, np.empty((0, knee.model.nq))).shape == (0, 4, 36)
