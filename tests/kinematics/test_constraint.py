"""The closures' Jacobian and drift are the derivatives of their residual, open or closed."""

from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from loopid import random_configurations
from loopid.errors import DataError
from loopid.kinematics import (
    constraint_drift,
    constraint_jacobian,
    constraint_residual,
    frame_poses,
)
from loopid.robot import relative_quaternion

KINDS = [("3d",), ("6d",), ("6d", "3d")]
seeds = st.integers(0, 2**32 - 1)


def with_kinds(mechanism, kinds):
    """The mechanism with other kinds of closures, which its loops need not obey."""
    pairs = zip(mechanism.closures, cycle(kinds), strict=False)
    return replace(mechanism, closures=tuple(replace(c, kind=kind) for c, kind in pairs))


def least_scalar(mechanism, q):
    """Cosine of half the turn between the frames of the closures that is nearest half a turn."""
    frames = [frame for closure in mechanism.closures for frame in closure.frame_ids]
    rotation = frame_poses(mechanism, q, frames).rotation
    pairs = range(0, len(frames), 2)
    return min(relative_quaternion(rotation[:, k], rotation[:, k + 1])[1].min() for k in pairs)


def open_configuration(mechanism, move, generator):
    steps = generator.uniform(-0.5, 0.5, size=(1, mechanism.model.nv))
    return move(mechanism, mechanism.reference[None], steps)


@pytest.mark.parametrize("kinds", KINDS, ids=" ".join)
@given(seed=seeds)
def test_the_jacobian_differentiates_the_residual_at_open_configurations(
    mechanism, kinds, move, rate, seed
):
    generator = np.random.default_rng(seed)
    robot = with_kinds(mechanism, kinds)
    q = open_configuration(robot, move, generator)
    assume(least_scalar(robot, q) > 0.1)  # twice the quaternion is smooth up to half a turn
    v = generator.uniform(-1, 1, size=(1, robot.model.nv))
    expected = rate(lambda t: constraint_residual(robot, move(robot, q, t * v)))
    found = np.einsum("nij,nj->ni", constraint_jacobian(robot, q), v)
    np.testing.assert_allclose(found, expected, atol=1e-10)


@pytest.mark.parametrize("kinds", KINDS, ids=" ".join)
@given(seed=seeds)
def test_the_drift_differentiates_the_jacobian_at_open_configurations(
    mechanism, kinds, move, rate, seed
):
    generator = np.random.default_rng(seed)
    robot = with_kinds(mechanism, kinds)
    q = open_configuration(robot, move, generator)
    assume(least_scalar(robot, q) > 0.1)
    v = generator.uniform(-1, 1, size=(1, robot.model.nv))
    expected = rate(
        lambda t: np.einsum("nij,nj->ni", constraint_jacobian(robot, move(robot, q, t * v)), v)
    )
    np.testing.assert_allclose(constraint_drift(robot, q, v), expected, atol=1e-9)


@pytest.mark.parametrize("kind", ["3d", "6d"])
def test_both_hold_where_the_loops_are_closed(four_bars, kind, move, rate):
    bar = four_bars[kind]
    q = random_configurations(bar, 5, seed=1)
    assert np.abs(constraint_residual(bar, q)).max() < 1e-12
    v = np.random.default_rng(2).uniform(-1, 1, size=(5, bar.model.nv))
    speed = rate(lambda t: constraint_residual(bar, move(bar, q, t * v)))
    A = constraint_jacobian(bar, q)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", A, v), speed, atol=1e-10)
    turned = rate(lambda t: constraint_jacobian(bar, move(bar, q, t * v)))
    expected = np.einsum("nij,nj->ni", turned, v)
    np.testing.assert_allclose(constraint_drift(bar, q, v), expected, atol=1e-9)


def test_a_weld_reads_as_a_pin_and_an_orientation(mechanism, poses):
    pins, welds = with_kinds(mechanism, ["3d"]), with_kinds(mechanism, ["6d"])
    translations = np.arange(welds.rows).reshape(-1, 6)[:, :3].ravel()
    for rows in (constraint_residual, constraint_jacobian):
        np.testing.assert_array_equal(rows(welds, poses)[:, translations], rows(pins, poses))


def test_the_residual_is_small_angle_in_rad(four_bars, move):
    # Turning the last hinge alone by a small angle opens the weld by that angle.
    bar, angle = four_bars["6d"], 1e-4
    step = np.zeros((1, bar.model.nv))
    step[0, bar.velocity_indices(["end_joint"])] = angle
    residual = constraint_residual(bar, move(bar, bar.reference[None], step))
    assert np.linalg.norm(residual[0, 3:]) == pytest.approx(angle, rel=1e-8)
    np.testing.assert_allclose(residual[0, :3], 0, atol=1e-12)


def test_a_tree_has_no_rows(mechanism, poses):
    tree = replace(mechanism, closures=())
    assert constraint_residual(tree, poses).shape == (len(poses), 0)
    assert constraint_jacobian(tree, poses).shape == (len(poses), 0, tree.model.nv)
    assert constraint_drift(tree, poses, np.zeros((len(poses), 13))).shape == (len(poses), 0)


@pytest.mark.parametrize("rows", [constraint_residual, constraint_jacobian])
def test_bad_configurations_are_refused(mechanism, rows):
    with pytest.raises(DataError, match=r"configurations.*\(samples, 13\), not \(2, 5\)"):
        rows(mechanism, np.zeros((2, 5)))
    bad = np.zeros((2, 13))
    bad[1, 4] = np.nan
    with pytest.raises(DataError, match=r"configurations must be finite.*\(1, 4\)"):
        rows(mechanism, bad)


@pytest.mark.parametrize(
    "velocities", [np.zeros((1, 4)), np.zeros((3, 13)), np.full((1, 13), np.inf)]
)
def test_bad_velocities_are_refused(mechanism, velocities):
    with pytest.raises(DataError, match="velocities"):
        constraint_drift(mechanism, np.tile(mechanism.reference, (2, 1)), velocities)
