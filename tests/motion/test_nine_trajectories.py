"""The nine bundled trajectories: what was handed down, and an independent model of the robot."""

import numpy as np
import pytest

from loopid.base_parameters import find_base
from loopid.kinematics.measured import platform_motion
from loopid.motion import LowPass, joint_motion, read_motion_program, review_motion
from loopid.regressors import gravity_regressor, structural_observation

# A (x, z, theta, psi), B, seconds from A to B, and z on the way as a function of x.
TABLE = {
    "1": ((-0.02, 0.70, 0, 0), (-0.20, 0.70, 0, 0), 18),
    "2": ((0.20, 0.70, 0.3491, 0), (-0.20, 0.70, -0.1396, 0), 40),
    "3": ((0.11, 0.67, 0.3142, 0), (0.11, 0.78, 0.3142, 0), 11),
    "4": ((0, 0.67, 0, -0.3491), (0, 0.78, 0, -0.3491), 11),
    "5": ((0, 0.67, 0, -0.4924), (0, 0.67, 0, 0.0873), 16.6),
    "6": ((0.20, 0.75, 0.2618, 0), (0, 0.75, 0.2618, 0), 20),
    "7": ((0.20, 0.75, 0.3491, 0), (0.08, 0.75, 0.3491, 0), 12),
    "8": ((0.20, 0.68, 0.2007, -0.2967), (-0.20, 0.68, 0, 0.1745), 40),
    "9": ((0.15, 0.68, 0.3491, -0.1745), (0.15, 0.68, 0.3491, 0.1745), 10),
}
ARCS = {
    "6": lambda x: 0.75 + 0.00835 * (1 - ((x - 0.10) / 0.10) ** 2),
    "7": lambda x: 0.75 + 0.0029 * (1 - ((x - 0.14) / 0.06) ** 2),
    "8": lambda x: 0.68 + 0.4 * (np.sqrt(0.0625 - x**2) - 0.15),
}
# Speeds in therapy, in m/s and rad/s.
THERAPY = np.array([0.02, 0.02, 0.035, 0.035])
# Knee rotations that the laboratory ran faster than in therapy: their times are given.
FAST = {"5", "9"}


@pytest.fixture(scope="module")
def program():
    return read_motion_program("3ups_rpu")


@pytest.fixture(scope="module", params=TABLE)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def motion(program, name):
    return program.motion(name)


def test_there_are_nine(program, knee):
    assert list(program.motions) == list(TABLE)
    assert program.coordinates == knee.platform.names
    assert all(plan.description for plan in program.motions.values())


def stays(values, place):
    """First and last samples (k, 2) of the segments in which the motion rests at a place."""
    near = np.abs(values - place).max(axis=1) < 1e-9
    edges = np.flatnonzero(np.diff(near.astype(int), prepend=0, append=0))
    return edges.reshape(-1, 2) - [0, 1]


def test_a_and_b_are_reached_and_held_for_two_seconds(motion, name):
    a, b, seconds = TABLE[name]
    at_a, at_b = stays(motion.position, a), stays(motion.position, b)
    assert len(at_b) == 4
    assert len(at_a) == 5  # on arrival, and after each way back
    for first, last in [*at_b, *at_a[1:]]:
        assert motion.time[last] - motion.time[first] == pytest.approx(2, abs=0.1)
    # Motion begins and ends with the third power of time: for some samples it is not to be seen.
    way = motion.time[at_b[:, 0]] - motion.time[at_a[:-1, 1]]
    np.testing.assert_allclose(way, seconds, atol=0.02 * seconds)


def test_it_starts_and_ends_at_rest_at_home(motion, name, program):
    home = program.motions[name].start
    (first, last), (back, end) = stays(motion.position, home)
    assert (first, end) == (0, len(motion) - 1)
    assert motion.time[last] >= 5
    assert motion.time[end] - motion.time[back] == pytest.approx(2, abs=0.1)
    assert (np.round(home, 2) == home).all()


def test_one_coordinate_at_a_time_moves_on_the_way_to_a(motion, name):
    arrival = stays(motion.position, TABLE[name][0])[0, 0]
    moving = np.abs(motion.velocity[:arrival]) > 1e-9
    assert moving.sum(axis=1).max() == 1
    order = [np.flatnonzero(row)[0] for row in moving[moving.any(axis=1)]]
    order = [k for k, before in zip(order, [None, *order], strict=False) if k != before]
    # z to a height between, then x, theta and psi as far as they differ, then z to that of A.
    assert order[0] == 1
    between = [k for k in order if k != 1]
    assert between == sorted(between)
    assert order in ([1, *between], [1, *between, 1])


def test_arcs_follow_their_formula(motion, name):
    a, b, _ = TABLE[name]
    at_a, at_b = stays(motion.position, a), stays(motion.position, b)
    way = motion.position[at_a[0, 1] : at_b[0, 0] + 1]
    if name in ARCS:
        np.testing.assert_allclose(way[:, 1], ARCS[name](way[:, 0]), atol=1e-9)
    else:
        fraction = np.linalg.norm(way - a, axis=1) / np.linalg.norm(np.subtract(b, a))
        straight = np.add(a, fraction[:, None] * np.subtract(b, a))
        np.testing.assert_allclose(way, straight, atol=1e-12)


def test_speeds_stay_within_those_of_therapy(motion, name):
    peak = np.abs(motion.velocity).max(axis=0)
    if name in FAST:
        a, b, seconds = TABLE[name]
        assert peak[3] == pytest.approx(1.875 * (b[3] - a[3]) / seconds, rel=1e-4)
        assert peak[3] < 2 * THERAPY[3]
        peak[3] = 0
    assert (peak <= THERAPY).all()


# The second file at hand holds another motion than the table's second.
@pytest.mark.parametrize("name", sorted(set(TABLE) - {"2"}))
def test_the_laboratorys_references_go_to_the_same_places(shared, knee, name):
    a, b, seconds = TABLE[name]
    folder = shared / "data" / "upv" / "references"
    file = folder / f"trr{name}.txt.gz"
    rows = np.loadtxt(file)
    at_a, at_b = (np.abs(rows - place).max(axis=1) < 1e-4 for place in (a, b))
    arrival = np.flatnonzero(at_b)[0]
    departure = np.flatnonzero(at_a[:arrival])[-1]
    assert (arrival - departure) / 100 == pytest.approx(seconds, abs=0.06)
    if name in ARCS:
        way = rows[departure : arrival + 1]
        np.testing.assert_allclose(way[:, 1], ARCS[name](way[:, 0]), atol=1e-4)
    smooth = LowPass(2.0).apply(rows, 100)
    assert min(np.abs(smooth - place).max(axis=1).min() for place in (a, b)) < 1e-3


# Least and greatest strokes in m, and the spherical joints' largest angle.
STROKES = np.array([[0.6537, 0.6474, 0.6502, 0.549], [0.9337, 0.9274, 0.9302, 0.829]])
SWING = np.deg2rad(38)
# The paper's first eight base parameters, by how their expressions begin.
FIRST_EIGHT = (
    *("platform.m + ", "leg1_stem.mx", "leg2_stem.mx", "leg3_stem.mx", "leg4_stem.my"),
    *("leg1_stem.mz", "leg2_stem.mz", "leg3_stem.mz"),
)
RATE = 2.0

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
def followed(program, knee, once):
    """What all joints do in each of the nine."""

    def moved():
        return {name: joint_motion(knee, program.motion(name, RATE)) for name in TABLE}

    return once("nine trajectories", moved)


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
    base = find_base(structural_observation(knee))
    tree = np.vstack([gravity_regressor(knee, moved.configurations) for moved in followed.values()])
    regressor = base.regressor(tree.reshape(-1, tree.shape[-1]))
    first = [k for k, text in enumerate(base.expressions) if text.startswith(FIRST_EIGHT)]
    # The laboratory's give about 345 with all 15, and about 52 with the first eight.
    assert (len(base), len(first)) == (15, 8)
    assert 300 < np.linalg.cond(regressor) < 400
    assert 45 < np.linalg.cond(regressor[:, first]) < 60
