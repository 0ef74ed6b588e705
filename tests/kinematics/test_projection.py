"""G and gamma are the velocities and accelerations of assembled motions."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from loopid import assemble, project, random_configurations
from loopid.errors import DataError, MobilityError, OptionError
from loopid.kinematics import (
    constraint_drift,
    constraint_jacobian,
    measured_coordinates,
    random_motions,
)

LIMB_4 = ("leg4_revolute", "leg4_stroke", "platform_pitch", "platform_yaw")
CASES = {
    "3ups_rpu": None,
    "5p": None,
    "3ups_rpu by limb 4": LIMB_4,
    "5p by limb 4": LIMB_4,
    "pinned bar": None,
    "welded bar": None,
    "welded knee": None,
}


@pytest.fixture(scope="module", params=CASES)
def motion(request, four_bars, load_once, weld, knee):
    """A mechanism, closed configurations, independent joints and their velocities."""
    made = {"pinned bar": four_bars["3d"], "welded bar": four_bars["6d"]}
    if request.param == "welded knee":
        made["welded knee"] = load_once(weld(knee.path))
    robot = made.get(request.param) or load_once(request.param.split(" ")[0])
    q = random_configurations(robot, 8, seed=3)
    rates, _ = random_motions(robot, 8, seed=4)
    return robot, q, CASES[request.param], 0.05 * rates


def followed(motion, t):
    """The configurations after a time t at constant independent velocities."""
    robot, q, independent, rates = motion
    values = measured_coordinates(robot, independent).read(q.copy())
    outcomes = [
        assemble(robot, value + t * rate, independent, start=start)
        for value, rate, start in zip(values, rates, q, strict=True)
    ]
    return np.concatenate(outcomes)


def velocities(motion, q):
    robot, _, independent, rates = motion
    return np.einsum("nij,nj->ni", project(robot, q, independent=independent).G, rates)


def test_the_closures_allow_every_column_of_g(motion):
    robot, q, independent, _ = motion
    A, G = constraint_jacobian(robot, q), project(robot, q, independent=independent).G
    assert np.abs(A @ G).max() < 1e-12


def test_independent_velocities_are_their_own(motion):
    robot, q, independent, rates = motion
    projection = project(robot, q, rates, independent)
    chosen = robot.velocity_indices(independent or robot.actuated)
    np.testing.assert_array_equal(projection.independent, chosen)
    np.testing.assert_array_equal(
        projection.G[:, chosen], np.tile(np.eye(len(chosen)), (len(q), 1, 1))
    )
    np.testing.assert_array_equal(projection.gamma[:, chosen], 0)


def test_g_is_the_velocity_of_the_assembled_motion(motion, rate):
    robot, q, _, _ = motion

    def displacement(t):
        pairs = zip(q, followed(motion, t), strict=True)
        return np.array([pin.difference(robot.model, *pair) for pair in pairs])

    np.testing.assert_allclose(velocities(motion, q), rate(displacement), atol=1e-7)


def test_gamma_is_the_acceleration_of_the_assembled_motion(motion, rate):
    robot, q, independent, rates = motion
    gamma = project(robot, q, rates, independent).gamma
    expected = rate(lambda t: velocities(motion, followed(motion, t)))
    np.testing.assert_allclose(gamma, expected, rtol=1e-6, atol=1e-6)


def test_gamma_balances_the_drift(motion):
    robot, q, independent, rates = motion
    A, gamma = constraint_jacobian(robot, q), project(robot, q, rates, independent).gamma
    drift = constraint_drift(robot, q, velocities(motion, q))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", A, gamma), -drift, atol=1e-10)


def test_gamma_is_quadratic_in_the_velocities(motion):
    robot, q, independent, rates = motion
    once = project(robot, q, rates, independent).gamma
    thrice = project(robot, q, 3 * rates, independent).gamma
    assert np.abs(once).max() > 1e-3
    np.testing.assert_allclose(thrice, 9 * once, atol=1e-9)


def test_two_choices_of_independent_joints_span_the_same_motions(mechanism, poses):
    strokes, limb_4 = project(mechanism, poses).G, project(mechanism, poses, independent=LIMB_4).G
    change = strokes[:, mechanism.velocity_indices(LIMB_4)]
    np.testing.assert_allclose(limb_4 @ change, strokes, atol=1e-9)


def test_a_tree_moves_freely(mechanism, poses):
    tree = replace(mechanism, closures=(), actuated=mechanism.joints)
    projection = project(tree, poses, np.ones((len(poses), 13)))
    np.testing.assert_array_equal(projection.G, np.tile(np.eye(13), (len(poses), 1, 1)))
    np.testing.assert_array_equal(projection.gamma, 0)
    np.testing.assert_array_equal(projection.singularity, 1)


def test_without_velocities_there_is_no_gamma(mechanism, poses):
    assert project(mechanism, poses).gamma is None


@pytest.mark.parametrize("rates", [np.zeros((12, 3)), np.zeros((2, 4)), np.full((12, 4), np.nan)])
def test_bad_velocities_are_refused(mechanism, poses, rates):
    with pytest.raises(DataError, match="independent velocities"):
        project(mechanism, poses, rates)


def test_bad_independent_joints_are_refused_by_name(mechanism, poses):
    with pytest.raises(OptionError, match=r"'knee'.*leg1_stroke"):
        project(mechanism, poses, independent=["knee"])
    with pytest.raises(MobilityError, match=r"twice.*leg1_stroke"):
        project(mechanism, poses, independent=["leg1_stroke", "leg1_stroke"])
    with pytest.raises(MobilityError, match=r"5 .* too many for 4 degrees of freedom"):
        project(mechanism, poses, independent=[*LIMB_4, "leg1_stroke"])
