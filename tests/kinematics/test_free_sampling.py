"""Random configurations of robots that spin, fly, turn without end or hardly move."""

import numpy as np
import pinocchio as pin
import pytest

from closure_robots import loop
from linkages import LINKAGES, four_bar
from loopid import project, random_configurations, singularity_measure
from loopid.kinematics import NEAR_SINGULARITY, constraint_residual

FLYING = ("five-bar", "ball rssr")
NAMES = ("ball rssr", *(f"flying {name}" for name in FLYING), "endless", "rocking", "2d loop",
         "bennett", "rack and pinion")  # fmt: skip


@pytest.fixture(scope="module", params=NAMES)
def robot(request, linkage, load_files, four_bars):
    name = request.param
    if name.startswith("flying "):
        return load_files(*LINKAGES[name.removeprefix("flying ")], floating_base=True)
    if name == "rocking":
        # The rocker drives a crank that turns fully: it reaches a narrow range only.
        parts, description = four_bar("hinge")
        return load_files(parts, description | {"name_mot": ["rocker_joint"]})
    return four_bars["3d"] if name == "endless" else linkage(name)


@pytest.fixture(scope="module")
def draws(robot):
    return random_configurations(robot, 80, seed=4)


def test_draws_are_closed_and_inside_the_limits(robot, draws):
    assert np.abs(constraint_residual(robot, draws)).max() < 1e-10
    low, high = robot.position_limits
    assert ((draws >= low - 1e-9) & (draws <= high + 1e-9)).all()
    assert (singularity_measure(robot, draws) >= NEAR_SINGULARITY).all()
    for q in draws:
        np.testing.assert_allclose(pin.normalize(robot.model, q), q, atol=1e-12)


def test_a_larger_count_only_adds_more(robot, draws):
    assert len(draws) == len(np.unique(draws, axis=0)) == 80
    for count in (1, 7, 65):
        few = random_configurations(robot, count, seed=4)
        np.testing.assert_array_equal(few, draws[:count])


def test_other_seeds_draw_others(robot, draws):
    other = random_configurations(robot, 80, seed=5)
    assert (np.abs(other - draws).max(axis=1) > 1e-4).all()


def test_every_independent_coordinate_varies_on_its_own(robot, draws):
    """The first draw's tangent space would show a coordinate that others determine, or none."""
    G = project(robot, draws).G
    steps = np.array([pin.difference(robot.model, draws[0], q) for q in draws[1:]])
    assert np.linalg.matrix_rank(steps, tol=0.05) >= G.shape[2]


def rotations(robot, draws, frame):
    data, found = robot.model.createData(), []
    for q in draws:
        pin.framesForwardKinematics(robot.model, data, q)
        found.append(data.oMf[robot.model.getFrameId(frame)].rotation.copy())
    return np.array(found)


@pytest.mark.parametrize("name", FLYING)
def test_a_floating_base_has_any_orientation_and_moves(name, load_files):
    robot = load_files(*LINKAGES[name], floating_base=True)
    q = random_configurations(robot, 200, seed=1)
    turns = rotations(robot, q, "ground")
    # Every axis of the base points into every octant.
    signs = {tuple(column) for turn in turns for column in np.sign(turn).T}
    assert len(signs) == 8
    assert np.abs(turns.mean(axis=0)).max() < 0.4
    assert (np.ptp(q[:, :3], axis=0) > 0.4 * robot.length).all()


def test_a_rod_spins_by_any_angle(linkage):
    robot = linkage("ball rssr")
    turns = rotations(robot, random_configurations(robot, 200, seed=1), "rod")
    # The angle about its own axis, against the plane of that axis and the vertical.
    upright = np.cross(turns[:, :, 0], [0, 0, 1])
    angles = np.arctan2(
        (turns[:, :, 2] * upright).sum(axis=1), (turns[:, :, 1] * upright).sum(axis=1)
    )
    assert np.histogram(angles, bins=8, range=(-np.pi, np.pi))[0].min() > 5


@pytest.mark.parametrize("kind", ["hinge", "6d", "universal"])
def test_hardly_reachable_ranges_are_still_explored(kind, load_files):
    # The motor's limits are far wider than what the loop allows.
    robot = load_files(*loop(kind, seed=4))
    q = random_configurations(robot, 100, seed=0)
    assert np.ptp(q[:, 0]) > 0.1
