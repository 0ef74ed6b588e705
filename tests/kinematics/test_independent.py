"""Independent coordinates: the motors in their order, then what they leave free; any others do."""

from dataclasses import replace

import numpy as np
import pytest

from linkages import five_bar, four_bar
from loopid import forward_dynamics, project, random_configurations, structural_observation
from loopid.base_parameters.structure import analyse
from loopid.kinematics import independent_coordinates, random_motions
from loopid.regressors import motion_regressor

CHOICES = {
    "cross rssr": [{"actuated": ("rocker_joint",)}, {"actuated": ("ball_Y",)}],
    "ball rssr": [
        {"actuated": ("rocker_joint",)},
        {"actuated": (), "free": ("ball.wx", "ball.wy")},
    ],
    "five-bar": [
        {"actuated": ("left_elbow", "right_elbow")},
        {"actuated": ("right_joint",), "free": ("left_elbow",)},
    ],
    "redundant five-bar": [{"redundant": ("left_joint",)}, {"redundant": ("right_joint",)}],
}


@pytest.mark.parametrize("motors", [("right_joint", "left_joint"), ("left_elbow", "right_joint")])
def test_motors_keep_their_order(motors, load_files):
    assert load_files(*five_bar(motors)).independent == motors


@pytest.mark.parametrize("first", [("left_joint", "right_joint"), ("right_joint", "left_elbow")])
def test_of_too_many_motors_the_first_ones_count_in_their_order(first, linkage):
    robot = linkage("redundant five-bar")
    others = (name for name in robot.actuated if name not in first)
    robot = replace(robot, actuated=(*first, *others))
    assert independent_coordinates(robot, robot.reference[None]) == first


def test_a_motor_that_cannot_move_is_no_coordinate(load_files):
    # The weld of the knuckle to the ground stops its hinge: rows, but no motion.
    robot = load_files(*four_bar("6d"))
    stuck = replace(robot, actuated=("crank_joint", "end_joint"))
    assert independent_coordinates(stuck, robot.reference[None]) == ("crank_joint",)


def rank(robot):
    return analyse(structural_observation(robot, "full", samples=60)).rank


@pytest.mark.parametrize("name", CHOICES)
def test_any_independent_coordinates_describe_the_same_motions(name, linkage):
    robot = linkage(name)
    q = random_configurations(robot, 5, seed=3)
    G = project(robot, q).G
    for choice in CHOICES[name]:
        other = replace(robot, **choice)
        assert other.independent != robot.independent
        again = project(other, q)
        np.testing.assert_allclose(again.G @ G[:, again.independent], G, atol=1e-9)
        assert rank(other) == rank(robot)


@pytest.mark.parametrize("name", ["ball rssr", "flying"])
def test_no_force_acts_on_what_is_free(name, linkage, load_files):
    flying = name == "flying"
    robot = load_files(*five_bar(), floating_base=True) if flying else linkage(name)
    q, (rates, _) = random_configurations(robot, 5), random_motions(robot, 5)
    motors = len(robot.actuated)
    forces = np.random.default_rng(1).uniform(-5, 5, size=(5, motors))
    motion = forward_dynamics(robot, q, rates, forces)
    felt = motion_regressor(robot, motion) @ robot.standard_parameters()
    np.testing.assert_allclose(felt[:, motors:], 0, atol=1e-9)
    np.testing.assert_allclose(felt[:, :motors], forces, atol=1e-9)
