"""The projected regressor gives the actuators' forces, by work and energy too."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from loopid import (
    assemble,
    dynamic_regressor,
    gravity_regressor,
    project,
    random_configurations,
    tree_regressor,
)
from loopid.errors import DataError
from loopid.kinematics import measured_coordinates, random_motions


def actuator_forces(moving):
    robot, q, rates, accelerations = moving
    return dynamic_regressor(robot, q, rates, accelerations) @ robot.standard_parameters()


def followed(robot, q, motion):
    """Closed configurations after a small motion (N, dof) of the actuated joints."""
    values = measured_coordinates(robot).read(q.copy()) + motion
    pairs = zip(values, q, strict=True)
    return np.concatenate([assemble(robot, value, start=start) for value, start in pairs])


def potential_energy(robot, q):
    data = robot.model.createData()
    return np.array([pin.computePotentialEnergy(robot.model, data, row) for row in q])


def kinetic_energy(robot, q, v):
    data = robot.model.createData()
    pairs = zip(q, v, strict=True)
    return np.array([pin.computeKineticEnergy(robot.model, data, *pair) for pair in pairs])


def test_actuator_forces_are_projected_inverse_dynamics(moving, inverse_dynamics):
    robot, q, rates, accelerations = moving
    projection = project(robot, q, rates)
    v = np.einsum("nij,nj->ni", projection.G, rates)
    a = np.einsum("nij,nj->ni", projection.G, accelerations) + projection.gamma
    tree = inverse_dynamics(robot, q, v, a)
    expected = np.einsum("nij,ni->nj", projection.G, tree)
    scale = np.abs(tree).max() * np.abs(projection.G).max()
    np.testing.assert_allclose(actuator_forces(moving), expected, atol=1e-12 * scale)


def test_actuator_power_is_the_rate_of_energy(moving, rate, all_velocities):
    # No inverse dynamics, drift or gamma here: energies along the assembled motion alone.
    robot, q, rates, accelerations = moving
    rates, accelerations = 0.1 * rates, 0.1 * accelerations

    def energy(t):
        at = followed(robot, q, t * rates + t**2 / 2 * accelerations)
        v = all_velocities(robot, at, rates + t * accelerations)
        return potential_energy(robot, at) + kinetic_energy(robot, at, v)

    forces = actuator_forces((robot, q, rates, accelerations))
    power = np.einsum("ni,ni->n", forces, rates)
    np.testing.assert_allclose(power, rate(energy), rtol=1e-6, atol=1e-6)


def test_holding_forces_are_the_slopes_of_potential_energy(moving, rate):
    robot, q, _, _ = moving
    forces = gravity_regressor(robot, q) @ robot.standard_parameters("gravity")
    for motor in range(forces.shape[1]):
        step = np.eye(forces.shape[1])[motor]

        def energy(t, step=step):
            return potential_energy(robot, followed(robot, q, t * step))

        slope = rate(energy, 3e-4)
        np.testing.assert_allclose(forces[:, motor], slope, rtol=1e-6, atol=1e-5)


def test_gravity_columns_are_the_full_ones_at_rest(moving):
    robot, q, _, _ = moving
    rest = np.zeros((len(q), len(robot.actuated)))
    full = dynamic_regressor(robot, q, rest, rest)
    columns = {label: j for j, label in enumerate(robot.parameters().labels)}
    shared_ones = [columns[label] for label in robot.parameters("gravity").labels]
    gravity = gravity_regressor(robot, q)
    scale = np.abs(gravity).max()
    np.testing.assert_allclose(gravity, full[:, :, shared_ones], atol=1e-13 * scale)
    inertias = np.setdiff1d(np.arange(full.shape[2]), shared_ones)
    np.testing.assert_allclose(full[:, :, inertias], 0, atol=1e-12 * scale)


@pytest.mark.parametrize("names", [("pinned bar", "welded bar"), ("3ups_rpu", "welded knee")])
def test_forces_do_not_depend_on_where_the_loops_are_cut(loops, names):
    pinned, welded = (loops[name] for name in names)
    assert pinned.parameters() == welded.parameters()
    strokes = measured_coordinates(pinned).read(random_configurations(pinned, 10, seed=0))
    motions = random_motions(pinned, 10, seed=0)
    one, other = (
        dynamic_regressor(robot, assemble(robot, strokes), *motions) for robot in (pinned, welded)
    )
    np.testing.assert_allclose(one, other, atol=1e-10 * np.abs(one).max())


def test_without_loops_it_is_the_trees_regressor(knee):
    tree = replace(knee, closures=(), actuated=knee.joints)
    q = random_configurations(tree, 4, seed=1)
    v, a = random_motions(tree, 4, seed=1)
    Y = tree_regressor(tree, q, v, a)
    scale = np.abs(Y).max()
    np.testing.assert_allclose(dynamic_regressor(tree, q, v, a), Y, atol=1e-14 * scale)


def test_rows_follow_the_order_of_the_motors(mechanism, poses):
    backwards = replace(mechanism, actuated=mechanism.actuated[::-1])
    np.testing.assert_allclose(
        gravity_regressor(backwards, poses),
        gravity_regressor(mechanism, poses)[:, ::-1],
        atol=1e-9,
    )


def test_one_sample_may_come_without_its_axis(mechanism, poses):
    rates = np.array([0.1, -0.2, 0.3, 0.4])
    alone = dynamic_regressor(mechanism, poses[0], rates, -rates)
    stacked = dynamic_regressor(mechanism, poses[:1], rates[None], -rates[None])
    np.testing.assert_array_equal(alone, stacked)


@pytest.mark.parametrize(
    ("name", "shapes"),
    [
        ("velocities", ((12, 3), (12, 4))),
        ("velocities", ((5, 4), (12, 4))),
        ("accelerations", ((12, 4), (12, 13))),
        ("accelerations", ((12, 4), (1, 4))),
    ],
)
def test_motions_of_the_wrong_shape_are_refused(mechanism, poses, name, shapes):
    with pytest.raises(DataError, match=f"{name} must have"):
        dynamic_regressor(mechanism, poses, *(np.zeros(shape) for shape in shapes))


def test_motions_that_are_not_finite_are_refused(mechanism, poses):
    good, bad = np.zeros((12, 4)), np.full((12, 4), np.nan)
    with pytest.raises(DataError, match="velocities must be finite"):
        dynamic_regressor(mechanism, poses, bad, good)
    with pytest.raises(DataError, match="accelerations must be finite"):
        dynamic_regressor(mechanism, poses, good, bad)
