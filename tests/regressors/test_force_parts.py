"""Inertial, Coriolis and gravity forces: what each part depends on, and that they add up."""

import numpy as np
import pytest

from loopid import dynamic_regressor, force_parts, gravity_regressor
from loopid.errors import DataError


def close(actual, expected, scale):
    np.testing.assert_allclose(actual, expected, atol=1e-11 * scale)


def test_parts_add_up_for_any_parameters(moving):
    robot, *state = moving
    pi = np.random.default_rng(0).normal(size=len(robot.parameters()))
    parts = force_parts(robot, *state, pi)
    K = dynamic_regressor(robot, *state)
    close(parts.total, K @ pi, np.abs(K).max() * np.abs(pi).max())


def test_inertial_forces_are_linear_in_the_accelerations_alone(moving):
    robot, q, rates, accelerations = moving
    parts = force_parts(robot, q, rates, accelerations)
    scale = np.abs(parts.total).max()
    tripled = force_parts(robot, q, 0.5 * rates, 3 * accelerations)
    close(tripled.inertial, 3 * parts.inertial, scale)
    close(force_parts(robot, q, rates, 0 * accelerations).inertial, 0, scale)


def test_coriolis_forces_are_quadratic_in_the_velocities_alone(moving):
    robot, q, rates, accelerations = moving
    parts = force_parts(robot, q, rates, accelerations)
    scale = np.abs(parts.total).max()
    doubled = force_parts(robot, q, 2 * rates, -accelerations)
    close(doubled.coriolis, 4 * parts.coriolis, scale)
    close(force_parts(robot, q, -rates, accelerations).coriolis, parts.coriolis, scale)


def test_gravity_is_what_holds_the_robot_at_rest(moving):
    robot, q, rates, accelerations = moving
    parts = force_parts(robot, q, rates, accelerations)
    held = gravity_regressor(robot, q) @ robot.standard_parameters("gravity")
    close(parts.gravity, held, np.abs(held).max())


def test_inertial_forces_do_positive_work_on_the_accelerations(moving):
    # The projected mass matrix is positive definite: üᵀ M ü > 0.
    robot, q, rates, accelerations = moving
    inertial = force_parts(robot, q, rates, accelerations).inertial
    assert (np.einsum("ni,ni->n", inertial, accelerations) > 0).all()


@pytest.mark.parametrize("wrong", [np.ones(7), np.full(90, np.nan)])
def test_wrong_parameters_are_refused(knee, wrong):
    rest = np.zeros((1, 4))
    with pytest.raises(DataError, match="standard parameters"):
        force_parts(knee, knee.reference[None], rest, rest, wrong)
