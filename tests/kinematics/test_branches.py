"""Assembly continues the branch of its start, sample by sample or along a trajectory."""

import numpy as np
import pytest

from loopid import assemble, platform_coordinates
from loopid.kinematics import constraint_jacobian, constraint_residual, partition, try_assemble

# Turned this far from the reference, the platform is beyond the type II singularity.
YAW_BEYOND = {"3ups_rpu": 0.6, "5p": 1.4}


def passive_determinant(mechanism, q):
    """Its sign tells apart the branches that meet where the motors lose control."""
    _, passive = partition(mechanism)
    return np.linalg.det(constraint_jacobian(mechanism, q)[:, :, passive])


def strokes_of(mechanism, q):
    return q[:, mechanism.velocity_indices(mechanism.actuated)]


def there_and_back(mechanism, poses, count):
    """Strokes that lead from the reference to a pose and back to the reference."""
    way = (1 - np.cos(np.linspace(0, 2 * np.pi, count))) / 2
    home, far = strokes_of(mechanism, np.stack([mechanism.reference, poses[0]]))
    return home + way[:, None] * (far - home)


@pytest.fixture(scope="module")
def trajectory(mechanism, poses):
    return there_and_back(mechanism, poses, 150)


def test_a_trajectory_there_and_back_ends_where_it_began(mechanism, trajectory):
    q = assemble(mechanism, trajectory, trajectory=True)
    np.testing.assert_allclose(q[-1], mechanism.reference, atol=1e-12)
    np.testing.assert_allclose(q, q[::-1], atol=1e-12)


def test_the_passive_determinant_keeps_its_sign(mechanism, trajectory, poses):
    at_home = passive_determinant(mechanism, mechanism.reference[None])
    along = passive_determinant(mechanism, assemble(mechanism, trajectory, trajectory=True))
    assert (along * at_home > 0).all()
    assert (passive_determinant(mechanism, poses) * at_home > 0).all()


def test_a_trajectory_is_assembled_like_its_samples_alone(mechanism, trajectory):
    np.testing.assert_allclose(
        assemble(mechanism, trajectory, trajectory=True),
        assemble(mechanism, trajectory),
        atol=1e-12,
    )


def test_a_trajectory_goes_on_after_lost_samples(mechanism, trajectory):
    expected, broken = assemble(mechanism, trajectory), trajectory.copy()
    # The whole of the second block is out of reach.
    lost = np.isin(np.arange(len(trajectory)), np.arange(64, 128))
    broken[lost, 0] = 9.0
    outcome = try_assemble(mechanism, broken, trajectory=True)
    np.testing.assert_array_equal(outcome.assembled, ~lost)
    np.testing.assert_allclose(outcome.configurations[~lost], expected[~lost], atol=1e-12)


def test_nothing_is_assembled_beyond_a_singularity(mechanism):
    # Far strokes too, most of them out of reach.
    centre = strokes_of(mechanism, mechanism.reference[None])
    strokes = centre + np.random.default_rng(1).uniform(-0.5, 0.5, size=(300, 4))
    found = try_assemble(mechanism, strokes)
    assert 20 < found.assembled.sum() < 280
    at_home = passive_determinant(mechanism, mechanism.reference[None])
    reached = passive_determinant(mechanism, found.configurations[found.assembled])
    assert (reached * at_home > 0).all()


@pytest.fixture(scope="module")
def sides(mechanism):
    """The reference, and a pose beyond the singularity."""
    home = platform_coordinates(mechanism, mechanism.reference)
    beyond = home + YAW_BEYOND[mechanism.name] * np.eye(4)[3]
    return assemble(mechanism, np.concatenate([home, beyond]), "platform")


def test_assembly_stays_on_the_side_of_its_start(mechanism, sides):
    signs = np.sign(passive_determinant(mechanism, sides))
    assert signs[0] * signs[1] == -1
    for side, sign in zip(sides, signs, strict=True):
        near = strokes_of(mechanism, side[None]) + 1e-4 * np.eye(4)
        q = assemble(mechanism, near, start=side)
        np.testing.assert_array_equal(np.sign(passive_determinant(mechanism, q)), sign)
        np.testing.assert_allclose(q, np.tile(side, (4, 1)), atol=0.02)


def test_the_same_strokes_close_on_both_sides(mechanism, sides):
    strokes = strokes_of(mechanism, sides[1:])
    here, beyond = (assemble(mechanism, strokes, start=side) for side in sides)
    for q in (here, beyond):
        assert np.abs(constraint_residual(mechanism, q)).max() < 1e-13
    np.testing.assert_allclose(beyond, sides[1:], atol=1e-12)
    assert passive_determinant(mechanism, here) * passive_determinant(mechanism, beyond) < 0


def crank_angles(bar, q):
    return np.arctan2(q[:, 1], q[:, 0])


@pytest.mark.parametrize("kind", ["3d", "6d"])
def test_along_two_turns_of_the_crank_no_joint_jumps(four_bars, kind):
    bar = four_bars[kind]
    angles = 1.0 + np.linspace(0, 4 * np.pi, 400)[:, None]
    q = assemble(bar, angles, trajectory=True)
    np.testing.assert_allclose(crank_angles(bar, q), np.angle(np.exp(1j * angles[:, 0])))
    assert np.abs(np.diff(q, axis=0)).max() < 0.2
    np.testing.assert_allclose(q[0], bar.reference, atol=1e-12)
    # The coupler is back where it was: relative to the crank it turned twice, backwards.
    turned = np.zeros(bar.model.nq)
    turned[bar.model.joints[bar.model.getJointId("coupler_joint")].idx_q] = -4 * np.pi
    np.testing.assert_allclose(q[-1], bar.reference + turned, atol=1e-12)


@pytest.mark.parametrize("kind", ["3d", "6d"])
def test_far_angles_of_the_crank_are_reached_as_by_small_steps(four_bars, kind):
    bar = four_bars[kind]
    for direction in (1, -1):
        angles = 1.0 + direction * np.linspace(0, 0.99 * np.pi, 200)[:, None]
        small_steps = assemble(bar, angles, trajectory=True)
        np.testing.assert_allclose(assemble(bar, angles), small_steps, atol=1e-12)


def test_an_endless_joint_is_measured_modulo_turns(four_bars):
    bar, angles = four_bars["3d"], np.array([[0.3], [2.0], [-1.0]])
    turned = angles + 2 * np.pi * np.array([[1], [-2], [5]])
    np.testing.assert_allclose(assemble(bar, turned), assemble(bar, angles), atol=1e-12)
