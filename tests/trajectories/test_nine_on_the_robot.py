"""The robot can follow the nine bundled trajectories: strokes, angles of legs, singularities.

Strokes, their derivatives and the legs' angles are computed in closed form, without the code under
test; limits are those of the hardware.
"""

import numpy as np
import pytest

from loopid import find_base_parameters, gravity_regressor, structural_observation
from loopid.kinematics import platform_motion
from loopid.trajectories import joint_motion, read_motion_program, review_motion

NAMES = tuple("123456789")
# Least and greatest strokes in m, and the spherical joints' largest angle.
STROKES = np.array([[0.6537, 0.6474, 0.6502, 0.549], [0.9337, 0.9274, 0.9302, 0.829]])
SWING = np.deg2rad(38)
# The paper's first eight base parameters, by how their expressions begin.
FIRST_EIGHT = (
    *("platform.m + ", "leg1_stem.mx", "leg2_stem.mx", "leg3_stem.mx", "leg4_stem.my"),
    *("leg1_stem.mz", "leg2_stem.mz", "leg3_stem.mz"),
)
RATE = 4.0

TURN_2, TURN_3 = np.deg2rad(90), np.deg2rad(45)
BASE = 0.4 * np.array(
    [[-1, 0, 0], [np.cos(TURN_2), np.sin(TURN_2), 0], [np.cos(TURN_3), -np.sin(TURN_3), 0]]
)
TURN_2, TURN_3 = np.deg2rad(50), np.deg2rad(90)
TOP = 0.3 * np.array(
    [[-1, 0, 0], [np.cos(TURN_2), np.sin(TURN_2), 0], [np.cos(TURN_3), -np.sin(TURN_3), 0]]
)
OFFSET = 0.15


def legs(pose):
    """Vectors (N, 3, 3) along legs 1 to 3 and the platform's normal (N, 3)."""
    x, z, theta, psi = pose.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    pitch = [[np.cos(theta), zero, np.sin(theta)], [zero, one, zero]]
    pitch = np.array([*pitch, [-np.sin(theta), zero, np.cos(theta)]])
    yaw = [[np.cos(psi), -np.sin(psi), zero], [np.sin(psi), np.cos(psi), zero]]
    yaw = np.array([*yaw, [zero, zero, one]])
    turn = np.einsum("ijn,jkn->nik", pitch, yaw)
    centre = np.stack([x, zero, z], axis=1)
    return centre[:, None] + np.einsum("nij,kj->nki", turn, TOP) - BASE, turn[:, :, 2]


def strokes(pose):
    outer = np.linalg.norm(legs(pose)[0], axis=2)
    return np.column_stack([outer, np.hypot(pose[:, 0] - OFFSET, pose[:, 1])])


def determinant(pose, step=1e-6):
    """Of the derivatives of the strokes by the platform coordinates, by central differences."""
    columns = [(strokes(pose + s) - strokes(pose - s)) / (2 * step) for s in step * np.eye(4)]
    return np.linalg.det(np.stack(columns, axis=2))


@pytest.fixture(scope="module")
def program():
    return read_motion_program("3ups_rpu")


@pytest.fixture(scope="module", params=NAMES)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def motion(program, name):
    return program.motion(name)


@pytest.fixture(scope="module")
def followed(program, knee):
    """What all joints do in each of the nine."""
    return {name: joint_motion(knee, program.motion(name, RATE)) for name in NAMES}


def test_strokes_stay_inside_their_limits(motion):
    reached = strokes(motion.position)
    assert (np.minimum(reached - STROKES[0], STROKES[1] - reached) > 0.003).all()


def test_no_leg_leans_further_than_its_spherical_joint_allows(motion):
    leg, normal = legs(motion.position)
    cosine = np.einsum("nki,ni->nk", leg, normal) / np.linalg.norm(leg, axis=2)
    assert np.arccos(cosine).max() < SWING


def test_the_determinant_keeps_away_from_zero(motion):
    found = determinant(motion.position[::10])
    # The laboratory treats less than 0.015 as near a singularity.
    assert found.min() > 0.023
    assert found.max() < 0.0645


def test_the_joints_follow(followed, knee, program, name):
    """Assembled strokes, and the derivatives of the strokes, are those in closed form."""
    poses = program.motion(name, RATE).position
    moved = followed[name]
    columns = [knee.joint(joint).idx_q for joint in knee.actuated]
    np.testing.assert_allclose(moved.configurations[:, columns], strokes(poses), atol=1e-10)
    some = moved.configurations[::40]
    indices = knee.velocity_indices(knee.actuated)
    still = np.zeros((len(some), 4))
    by_pose = [platform_motion(knee, some, still + unit, still)[0] for unit in np.eye(4)]
    found = np.linalg.det(np.stack(by_pose, axis=2)[:, indices])
    np.testing.assert_allclose(found, determinant(poses[::40]), atol=1e-8)


def test_a_review_finds_nothing_against_any(followed, knee, name):
    review = review_motion(knee, followed[name])
    assert review.problems == ()
    clearance = {found.joint: found.clearance for found in review.ranges}
    assert set(clearance) == set(knee.joints)
    assert min(clearance.values()) > 0.003
    assert review.singularity > 0.06
    assert all(0 < speed < 0.03 for speed in review.speeds.values())


def test_all_nine_together_condition_the_gravity_parameters_as_the_laboratorys_do(followed, knee):
    base = find_base_parameters(structural_observation(knee))
    tree = np.vstack([gravity_regressor(knee, moved.configurations) for moved in followed.values()])
    regressor = base.regressor(tree.reshape(-1, tree.shape[-1]))
    first = [k for k, text in enumerate(base.expressions) if text.startswith(FIRST_EIGHT)]
    # The laboratory's give about 345 with all 15, and about 52 with the first eight.
    assert (len(base), len(first)) == (15, 8)
    assert 300 < np.linalg.cond(regressor) < 400
    assert 45 < np.linalg.cond(regressor[:, first]) < 60
