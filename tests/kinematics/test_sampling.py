"""Random closed configurations: reproducible, admissible, and different for other seeds."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from bank_robots import few_of
from closure_robots import loop
from linkages import LINKAGES, four_bar
from loopid import random_configurations
from loopid.errors import AssemblyError, OptionError
from loopid.kinematics import (
    SamplingOptions,
    assemble,
    constraint_residual,
    project,
    random_motions,
)
from loopid.kinematics.projection import NEAR_SINGULARITY, singularity_measure


def test_the_margin_is_kept(mechanism):
    q = random_configurations(
        mechanism, 40, seed=0, options=SamplingOptions(singularity_threshold=0.06)
    )
    assert (singularity_measure(mechanism, q) >= 0.06).all()


def test_strokes_are_spread_over_their_whole_range(mechanism):
    motors = mechanism.velocity_indices(mechanism.actuated)
    strokes = random_configurations(mechanism, 200, seed=0)[:, motors]
    ranges = mechanism.model.upperPositionLimit - mechanism.model.lowerPositionLimit
    assert (np.ptp(strokes, axis=0) > 0.9 * ranges[motors]).all()


def test_configurations_lie_on_the_references_branch(mechanism):
    q = random_configurations(mechanism, 20, seed=0)
    motors = mechanism.velocity_indices(mechanism.actuated)
    np.testing.assert_allclose(assemble(mechanism, q[:, motors]), q, atol=1e-10)


def test_an_endless_motor_is_drawn_over_a_whole_turn(four_bars):
    bar = four_bars["6d"]
    q = random_configurations(bar, 100, seed=0)
    angles = np.arctan2(q[:, 1], q[:, 0])
    assert np.ptp(angles) > 1.9 * np.pi


def test_a_margin_that_none_keeps_is_refused(knee):
    # The measure of a tree is 1, and its draws are cheap.
    tree = replace(knee, closures=(), actuated=knee.joints)
    assert (
        len(random_configurations(tree, 3, options=SamplingOptions(singularity_threshold=1))) == 3
    )
    with pytest.raises(AssemblyError) as refused:
        random_configurations(
            knee, 3, options=SamplingOptions(singularity_threshold=1.0, attempts=1)
        )
    assert refused.value.facts["singularity_threshold"] == 1


@pytest.mark.parametrize(
    "ask",
    [
        lambda robot: random_configurations(robot, 0),
        lambda robot: random_configurations(robot, 10**10),
        *(lambda robot, x=x: SamplingOptions(singularity_threshold=x) for x in (-0.1, 1.1, np.nan)),
    ],
)
def test_absurd_arguments_are_refused(mechanism, ask):
    with pytest.raises(OptionError):
        ask(mechanism)


def test_random_motions_are_seeded_and_of_the_order_of_gravity(mechanism):
    motions = random_motions(mechanism, 500, seed=3)
    for first, again in zip(motions, random_motions(mechanism, 500, seed=3), strict=True):
        np.testing.assert_array_equal(first, again)
        assert first.shape == (500, 4)
    velocities, accelerations = motions
    # Strokes: in m, free fall over the characteristic length.
    assert np.abs(accelerations).max() == pytest.approx(9.81, rel=0.01)
    fall = np.sqrt(9.81 * mechanism.length)
    assert np.abs(velocities).max() == pytest.approx(fall, rel=0.01)


NAMES = few_of(
    (
        "3ups_rpu",
        "ball rssr",
        "flying five-bar",
        "endless",
        "rocking",
        "bennett",
        "rack and pinion",
    ),
    *("ball rssr", "flying five-bar"),
)


@pytest.fixture(scope="module", params=NAMES)
def robot(request, knee, linkage, load_files, four_bars):
    name = request.param
    if name.startswith("flying "):
        return load_files(*LINKAGES[name.removeprefix("flying ")], floating_base=True)
    if name == "rocking":
        # The rocker drives a crank that turns fully: it reaches a narrow range only.
        parts, description = four_bar("hinge")
        return load_files(parts, description | {"name_mot": ["rocker_joint"]})
    others = {"3ups_rpu": knee, "endless": four_bars["3d"]}
    return others[name] if name in others else linkage(name)


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


def test_a_larger_count_only_adds_more_of_any_robot(robot, draws):
    assert len(draws) == len(np.unique(draws, axis=0)) == 80
    fresh = replace(robot)  # which keeps what it draws from now on
    for count in (1, 65, 80):
        few = random_configurations(fresh, count, seed=4)
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


def test_a_floating_base_has_any_orientation_and_moves(load_files):
    robot = load_files(*LINKAGES["five-bar"], floating_base=True)
    q = random_configurations(robot, 100, seed=1)
    turns = rotations(robot, q, "ground")
    # Every axis of the base points into every octant.
    signs = {tuple(column) for turn in turns for column in np.sign(turn).T}
    assert len(signs) == 8
    assert np.abs(turns.mean(axis=0)).max() < 0.4
    assert (np.ptp(q[:, :3], axis=0) > 0.4 * robot.length).all()


def test_a_rod_spins_by_any_angle(linkage):
    robot = linkage("ball rssr")
    turns = rotations(robot, random_configurations(robot, 120, seed=1), "rod")
    # The angle about its own axis, against the plane of that axis and the vertical.
    upright = np.cross(turns[:, :, 0], [0, 0, 1])
    angles = np.arctan2(
        (turns[:, :, 2] * upright).sum(axis=1), (turns[:, :, 1] * upright).sum(axis=1)
    )
    assert np.histogram(angles, bins=8, range=(-np.pi, np.pi))[0].min() > 5


def test_hardly_reachable_ranges_are_still_explored(load_files):
    # The motor's limits are far wider than what the loop allows.
    robot = load_files(*loop("hinge", seed=4))
    q = random_configurations(robot, 40, seed=0)
    assert np.ptp(q[:, 0]) > 0.1
