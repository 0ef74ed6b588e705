"""Loops close from bad starts wherever they can, and are refused with a number where not."""

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from bank_robots import few_of
from closure_robots import loop
from linkages import LINKAGES, five_bar, four_bar, rssr
from loopid import random_configurations
from loopid.errors import RobotFileError
from loopid.kinematics import constraint_residual
from loopid.kinematics.closing import close_loops
from loopid.kinematics.constraint import largest_residual

ANYWHERE = (
    "hinge four-bar",
    "6d four-bar",
    "cross rssr",
    "five-bar",
    "3d loop",
    "2d loop",
    "bennett",
)
CLEAR = 1e-3  # m by which a random linkage is well inside or outside what it reaches
lengths = st.floats(0.1, 1.0)


def scattered(robot, count, seed=0):
    low, high = robot.position_limits
    generator = np.random.default_rng(seed)
    return generator.uniform(np.maximum(low, -3), np.minimum(high, 3), size=(count, robot.model.nq))


@pytest.mark.parametrize("name", few_of(ANYWHERE, "6d four-bar", "cross rssr", "bennett"))
def test_loops_close_from_anywhere_inside_the_limits(name, linkage):
    robot = linkage(name)
    q, gap = close_loops(robot, scattered(robot, 40))
    np.testing.assert_allclose(gap, largest_residual(robot, q), rtol=0, atol=1e-15)
    closed = gap < 1e-12
    assert closed.sum() > 30
    assert np.abs(constraint_residual(robot, q[closed])).max() < 1e-11
    np.testing.assert_array_equal(close_loops(robot, scattered(robot, 40))[0], q)


def test_joints_that_their_limits_stop_let_others_close_the_loops(mechanism):
    # Strokes have narrow limits: without care three starts of four would end beyond them.
    q, gap = close_loops(mechanism, scattered(mechanism, 40))
    low, high = mechanism.position_limits
    inside = ((q > low - 1e-6) & (q < high + 1e-6)).all(axis=1)
    assert ((gap < 1e-12) & inside).sum() > 35


def test_coordinates_that_may_not_move_do_not(linkage):
    robot = linkage("cross rssr")
    start = random_configurations(robot, 6) + np.random.default_rng(0).normal(0, 0.05, (6, 4))
    movable = robot.velocity_indices(robot.passive)
    q, gap = close_loops(robot, start, movable)
    assert gap.max() < 1e-12
    motors = robot.velocity_indices(robot.actuated)
    np.testing.assert_array_equal(q[:, motors], start[:, motors])


def reach(bars, angle):
    """By how much (m) a four-bar reaches its pivot at a crank angle; negative where it does not."""
    crank, coupler, rocker, ground = bars
    way = np.hypot(ground - crank * np.cos(angle), crank * np.sin(angle))
    return min(coupler + rocker - way, way - abs(coupler - rocker))


def with_bars(kind, bars, reference):
    names = ("crank", "coupler", "rocker", "ground")
    parts, description = four_bar(kind, dict(zip(names, bars, strict=True)))
    return parts, description | {"reference": reference}


@settings(max_examples=3)
@given(bars=st.tuples(*[lengths] * 4), angle=st.floats(-2.9, 2.9))
def test_a_four_bar_loads_exactly_where_its_crank_can_be(bars, angle, load_files):
    assume(abs(reach(bars, angle)) > CLEAR)
    described = with_bars("2d", bars, {"crank_joint": angle})
    if reach(bars, angle) < 0:
        with pytest.raises(RobotFileError, match=r"cannot be closed: closure end-pivot stays open"):
            load_files(*described)
        return
    robot = load_files(*described)
    assert robot.reference[0] == angle
    assert largest_residual(robot, robot.reference[None])[0] < 1e-10


@settings(max_examples=2)
@given(bars=st.tuples(*[lengths] * 4))
def test_without_a_reference_a_four_bar_loads_where_its_bars_form_a_loop(bars, load_files):
    spare = sum(bars) - 2 * max(bars)
    assume(abs(spare) > 0.05)
    if spare > 0:
        robot = load_files(*with_bars("hinge", bars, {}))
        assert largest_residual(robot, robot.reference[None])[0] < 1e-10
        return
    with pytest.raises(RobotFileError, match="give one as 'reference'") as failure:
        load_files(*with_bars("hinge", bars, {}))
    left = float(re.search(r"stays open by (\S+) m", str(failure.value))[1])
    # The largest of three components of a gap as long as the bars are too short.
    assert -spare / np.sqrt(3) - 1e-3 < left < -spare + 1e-3


def test_loading_without_a_reference_is_repeatable(load_files):
    parts, description = LINKAGES["ball rssr"]
    blank = description | {"reference": {}}
    first, second = (load_files(parts, blank).reference for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")  # of other modes
def test_loops_are_found_for_motors_alone(load_files):
    parts, description = loop("3d", seed=4)
    motor = description["reference"]["joint1"]
    robot = load_files(parts, description | {"reference": {"joint1": motor}})
    assert robot.reference[0] == motor
    assert largest_residual(robot, robot.reference[None])[0] < 1e-10


def limited(parts, name, limits):
    """The robot's parts with other limits of a joint."""
    texts = 'lower="{}" upper="{}"'.format(*limits)
    named = f'joint name="{name}"'
    return [re.sub('lower=".*" upper="[^"]*"', texts, p) if named in p else p for p in parts]


def test_limits_choose_the_branch(load_files, linkage):
    parts, description = five_bar()
    description["reference"] = {"left_joint": 2.0, "right_joint": 1.0}
    robot = linkage("five-bar")
    motors = robot.velocity_indices(robot.actuated)
    starts = scattered(robot, 40)
    starts[:, motors] = robot.reference[motors]
    q, gap = close_loops(robot, starts, robot.velocity_indices(robot.passive))
    elbows = np.arctan2(np.sin(q[gap < 1e-12, 1]), np.cos(q[gap < 1e-12, 1]))
    branches = elbows.min(), elbows.max()
    assert np.ptp(branches) > 0.5
    for elbow in branches:
        limits = elbow - 0.2, elbow + 0.2
        found = load_files(limited(parts, "left_elbow", limits), description).reference
        assert found[1] == pytest.approx(elbow, abs=1e-9)


def test_a_rod_that_is_too_short_is_named_with_its_gap(load_files):
    parts, description = rssr(None)
    short = description["closures"][0] | {"length": 0.01}
    with pytest.raises(
        RobotFileError, match=r"crank_tip-rocker_tip stays open by \d\.\de[+-]\d\d m"
    ):
        load_files(parts, description | {"closures": [short]})
