"""The regressor of a motion: bodies, then the terms of the joints."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from loopid import (
    JointTerms,
    closed_motion,
    dynamic_regressor,
    find_base_parameters,
    gravity_regressor,
    random_configurations,
    structural_observation,
)
from loopid.errors import OptionError
from loopid.kinematics import random_motions
from loopid.regressors import JOINT_TERMS, motion_parameters, motion_regressor

KINDS = tuple(JOINT_TERMS)


@pytest.fixture
def motion(moving):
    return closed_motion(*moving)


def with_random_inertias(robot, seed):
    """The same robot with other bodies."""
    model, generator = robot.model.copy(), np.random.default_rng(seed)
    for body in robot.bodies:
        spread = generator.normal(size=(3, 3))
        mass, lever = generator.uniform(0.5, 5.0), generator.normal(size=3)
        model.inertias[body.joint_id] = pin.Inertia(mass, lever, spread @ spread.T)
    return replace(robot, model=model)


def test_parameters_give_projected_inverse_dynamics_for_any_inertias(
    moving, motion, inverse_dynamics
):
    robot = with_random_inertias(moving[0], seed=3)
    tree = inverse_dynamics(robot, motion.configurations, motion.velocities, motion.accelerations)
    expected = np.einsum("nij,ni->nj", motion.projection.G, tree)
    forces = motion_regressor(robot, motion) @ robot.standard_parameters()
    scale = np.abs(tree).max() * np.abs(motion.projection.G).max()
    np.testing.assert_allclose(forces, expected, atol=1e-11 * scale)


def test_without_joint_terms_it_is_the_dynamic_regressor(moving, motion):
    np.testing.assert_array_equal(motion_regressor(moving[0], motion), dynamic_regressor(*moving))


def test_the_gravity_model_does_not_see_the_motion(moving, motion):
    robot, q, rates, accelerations = moving
    columns = motion_regressor(robot, motion, "gravity")
    scale = np.abs(columns).max()
    np.testing.assert_allclose(columns, gravity_regressor(robot, q), atol=1e-13 * scale)
    faster = closed_motion(robot, q, 5 * rates, -accelerations)
    np.testing.assert_array_equal(motion_regressor(robot, faster, "gravity"), columns)


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_joint_terms_follow_the_bodies(moving, motion, model):
    robot = moving[0]
    terms = JointTerms(robot.actuated, KINDS)
    both = motion_regressor(robot, motion, model, terms)
    width = len(robot.parameters(model))
    np.testing.assert_array_equal(both[:, :, :width], motion_regressor(robot, motion, model))
    np.testing.assert_array_equal(both[:, :, width:], terms.columns(robot, motion))


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_joint_forces_reach_the_motors_through_the_loops(moving, motion, model):
    # By hand: the terms of every joint, passive ones too, pressed through the transposed Gᵀ.
    robot = moving[0]
    v, a, G = motion.velocities, motion.accelerations, motion.projection.G
    terms = JointTerms(robot.joints, KINDS)
    phi = np.random.default_rng(4).normal(size=(len(robot.joints), len(KINDS)))
    signals = {"Ia": a, "Fc": np.sign(v), "Fv": v, "Fo": np.ones_like(v)}
    in_joints = sum(phi[:, k] * signals[kind] for k, kind in enumerate(KINDS))
    columns = motion_regressor(robot, motion, model, terms)[:, :, len(robot.parameters(model)) :]
    expected = np.einsum("nji,nj->ni", G, in_joints)
    np.testing.assert_allclose(columns @ phi.ravel(), expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_labels_name_the_columns(moving, motion, model):
    robot = moving[0]
    terms = JointTerms(robot.actuated, ("Fv", "Fc"))
    names = motion_parameters(robot, model, terms)
    assert names.labels == (
        *robot.parameters(model).labels,
        *(f"{joint}.{kind}" for joint in robot.actuated for kind in ("Fv", "Fc")),
    )
    assert motion_regressor(robot, motion, model, terms).shape[2] == len(names)
    assert motion_parameters(robot, model) == robot.parameters(model)


def test_an_unknown_model_is_refused(knee, moving, motion):
    with pytest.raises(OptionError, match=r"'half'.*gravity, full"):
        motion_regressor(moving[0], motion, "half")


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_random_motion_tells_every_term_of_the_motors_from_the_bodies(knee, model):
    terms = JointTerms(knee.actuated, KINDS)
    observation = structural_observation(knee, model, joint_terms=terms)
    assert observation.parameters == motion_parameters(knee, model, terms)
    found = find_base_parameters(observation)
    alone = find_base_parameters(structural_observation(knee, model))
    assert len(found) == len(alone) + 16
    assert set(terms.parameters(knee).labels) <= set(found.names)
    q, motions = random_configurations(knee, 40, seed=9), random_motions(knee, 40, seed=8)
    fresh = motion_regressor(knee, closed_motion(knee, q, *motions), model, terms)
    assert found.reconstruction_error(fresh) < 1e-11


def test_a_seed_gives_the_same_moving_poses_again(knee):
    terms = JointTerms(knee.actuated)
    first, again, other = (
        structural_observation(knee, samples=40, seed=seed, joint_terms=terms, keep_matrix=True)
        for seed in (2, 2, 3)
    )
    np.testing.assert_array_equal(first.matrix, again.matrix)
    assert not np.array_equal(first.matrix, other.matrix)
