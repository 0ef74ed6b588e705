"""The tree's regressor times the parameters is inverse dynamics."""

import numpy as np
import pinocchio as pin
import pytest

from loopid import load_mechanism, tree_regressor
from loopid.errors import DataError, OptionError

TREES = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", ()),
    "panda": (
        "panda_description/urdf/panda.urdf",
        ("panda_finger_joint1", "panda_finger_joint2"),
    ),
    "kinova": ("kinova_description/robots/kinova.urdf", ()),
}


def random_states(robot, count, seed):
    generator = np.random.default_rng(seed)
    nv = robot.model.nv
    steps, v, a = generator.uniform(-1, 1, size=(3, count, nv))
    q = np.array([pin.integrate(robot.model, robot.reference, step) for step in steps])
    return q, v, a


def assert_inverse_dynamics(robot, inverse_dynamics):
    q, v, a = random_states(robot, 5, seed=2)
    Y = tree_regressor(robot, q, v, a)
    assert Y.shape == (5, robot.model.nv, len(robot.parameters()))
    expected = inverse_dynamics(robot, q, v, a)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(Y @ robot.standard_parameters(), expected, atol=1e-12 * scale)


def test_open_loops_move_by_inverse_dynamics(loops, inverse_dynamics):
    for robot in loops.values():
        assert_inverse_dynamics(robot, inverse_dynamics)


@pytest.mark.parametrize("name", TREES)
def test_serial_robots_move_by_inverse_dynamics(name, robot_data, inverse_dynamics):
    path, lock = TREES[name]
    assert_inverse_dynamics(load_mechanism(robot_data / path, lock=lock), inverse_dynamics)


def test_without_motion_the_robot_rests(knee):
    q, _, _ = random_states(knee, 3, seed=1)
    rest = np.zeros((3, knee.model.nv))
    np.testing.assert_array_equal(tree_regressor(knee, q), tree_regressor(knee, q, rest, rest))


def test_the_gravity_columns_are_the_full_ones(loops):
    for robot in loops.values():
        q, v, a = random_states(robot, 3, seed=4)
        full = dict(
            zip(
                robot.parameters().labels,
                np.moveaxis(tree_regressor(robot, q, v, a), 2, 0),
                strict=True,
            )
        )
        gravity = tree_regressor(robot, q, v, a, model="gravity")
        for j, label in enumerate(robot.parameters("gravity").labels):
            np.testing.assert_array_equal(gravity[:, :, j], full[label])


@pytest.mark.parametrize(
    ("name", "motions"),
    [
        ("configurations", (np.zeros((2, 5)),)),
        ("configurations", (np.full((2, 13), np.nan),)),
        ("velocities", (np.zeros((2, 13)), np.zeros((2, 4)))),
        ("velocities", (np.zeros((2, 13)), np.zeros((3, 13)))),
        ("accelerations", (np.zeros((2, 13)), np.zeros((2, 13)), np.full((2, 13), np.inf))),
        ("accelerations", (np.zeros((2, 13)), np.zeros((2, 13)), np.zeros((1, 13)))),
    ],
)
def test_bad_states_are_refused_by_name(knee, name, motions):
    with pytest.raises(DataError, match=f"^{name} must"):
        tree_regressor(knee, *motions)


def test_an_unknown_model_is_refused(knee):
    with pytest.raises(OptionError, match=r"'static'.*gravity, full"):
        tree_regressor(knee, knee.reference, model="static")
