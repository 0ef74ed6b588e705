"""Closures of every kind: derivatives, freedoms, units, and the motions they allow."""

from dataclasses import replace
from itertools import cycle

import numpy as np
import pinocchio as pin
import pytest
from free_pair import (
    KINDS,
    ROD,
    allowed,
    at_random,
    at_relative,
    free_pair,
    relative_pose,
    violation,
)
from hypothesis import given, settings, strategies as st

import pinocchio_loops
from bank_robots import few_of
from closure_robots import ROWS, in_millimetres
from linkages import LINKAGES, ORDINARY, PLANAR
from loopid import random_configurations
from loopid.base_parameters import find_base
from loopid.errors import DataError, OptionError
from loopid.kinematics import (
    assemble,
    constraint_drift,
    constraint_jacobian,
    constraint_residual,
    mobility,
    project,
)
from loopid.kinematics.closing import close_loops
from loopid.kinematics.projection import null_space, singularity_measure
from loopid.regressors import structural_observation
from loopid.robot import CLOSURE_KINDS
from loopid.robot.closures import ClosureKind, RightAngle


def with_kinds(mechanism, kinds):
    """The mechanism with other kinds of closures, which its loops need not obey."""
    pairs = zip(mechanism.closures, cycle(kinds), strict=False)
    return replace(mechanism, closures=tuple(replace(c, kind=kind) for c, kind in pairs))


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
    with pytest.raises(DataError) as error:
        rows(mechanism, np.zeros((2, 5)))
    assert error.value.facts == {"argument": "configurations", "given": (2, 5), "width": 13}
    bad = np.zeros((2, 13))
    bad[1, 4] = np.nan
    with pytest.raises(DataError, match=r"configurations must be finite.*\(1, 4\)"):
        rows(mechanism, bad)


@pytest.mark.parametrize(
    "velocities", [np.zeros((1, 4)), np.zeros((3, 13)), np.full((1, 13), np.inf)]
)
def test_bad_velocities_are_refused(mechanism, velocities):
    with pytest.raises(DataError) as error:
        constraint_drift(mechanism, np.tile(mechanism.reference, (2, 1)), velocities)
    assert error.value.facts["argument"] == "velocities"


# Coordinates, equations, independent ones, of linkages that are not loops of rows + 1 joints.
COUNTS = {
    "3d four-bar": (3, 3, 2),
    "6d four-bar": (4, 6, 3),
    "hinge four-bar": (3, 5, 2),
    "universal four-bar": (3, 4, 2),
    "cylindrical four-bar": (3, 4, 2),
    "2d four-bar": (3, 2, 2),
    "distance four-bar": (2, 1, 1),
    "prismatic slider-crank": (3, 5, 2),
    "cylindrical slider-crank": (3, 4, 2),
    "cable loop": (3, 1, 1),
    "bennett": (3, 5, 2),
    "rod rssr": (2, 1, 1),
    "ball rssr": (5, 3, 3),
    "cross rssr": (4, 3, 3),
    "five-bar": (4, 3, 2),
    "redundant five-bar": (4, 3, 2),
    "geared five-bar": (4, 4, 3),
    "rack and pinion": (3, 1, 1),
    "cam": (3, 1, 1),
    "differential": (4, 2, 2),
}
SHARED = ("crank_joint", "coupler_joint", "rocker_joint")


@pytest.fixture(
    scope="module",
    params=few_of([name for name in LINKAGES if "skew" not in name], *ORDINARY),
)
def robot(request, linkage):
    return linkage(request.param)


@pytest.fixture(scope="module")
def closed(robot):
    return random_configurations(robot, 4, seed=5)


def test_every_linkage_has_its_rank(robot, request):
    name = request.node.callspec.params["robot"]
    rows = ROWS.get(name.split()[0], 0)
    coordinates, rows, rank = COUNTS.get(name, (rows + 1, rows, rows))
    found = mobility(robot)
    assert (robot.model.nv, found.rows, found.rank) == (coordinates, rows, rank)
    assert found.degrees_of_freedom == found.generic_degrees_of_freedom == coordinates - rank
    assert found.rank_gap > 1e12


def test_the_velocity_map_spans_what_the_closures_allow(robot, closed):
    A, G = constraint_jacobian(robot, closed), project(robot, closed).G
    assert np.abs(A @ G).max() < 1e-12
    for jacobian, motions in zip(A, G, strict=True):
        assert null_space(jacobian).shape == motions.shape


@pytest.mark.parametrize("name", ["6d loop", "distance loop", "ball rssr", "rack and pinion"])
def test_a_robot_in_millimetres_is_the_same(name, linkage, load_files):
    robot, other = linkage(name), load_files(*in_millimetres(*LINKAGES[name]))
    closed, scales = random_configurations(robot, 4, seed=5), np.ones(robot.model.nq)
    scales[robot.prismatic] = 1000.0
    assert other.independent == robot.independent
    assert np.abs(constraint_residual(other, closed * scales)).max() < 1e-10
    measures = [singularity_measure(*pair) for pair in ((robot, closed), (other, closed * scales))]
    np.testing.assert_allclose(*measures, rtol=1e-9)
    assert mobility(other).rank == mobility(robot).rank


@pytest.mark.parametrize("kind", [kind for kind in PLANAR if kind not in ("hinge", "distance")])
def test_a_four_bar_moves_alike_however_its_pin_is_written(kind, linkage):
    hinged, other = linkage("hinge four-bar"), linkage(f"{kind} four-bar")
    q = random_configurations(hinged, 20, seed=5)
    again = assemble(other, q[:, :1])
    np.testing.assert_allclose(again[:, :3], q, atol=1e-9)
    G, same = project(hinged, q).G, project(other, again).G
    np.testing.assert_allclose(same[:, :3], G, atol=1e-9)


@pytest.mark.parametrize("kind", few_of([kind for kind in PLANAR if kind != "distance"], "6d"))
def test_a_four_bar_has_its_base_parameters_however_its_pin_is_written(kind, linkage):
    # Planar: 4 of each body, less a mass carried by each pivot and one a pin; see mechanisms.md.
    observation = structural_observation(linkage(f"{kind} four-bar"), "full")
    assert len(find_base(observation)) == 8


AXES = {
    "z": ((0, 0, 1), (0, 0, 1)),
    "skew": ((0.3, -0.8, 0.5), (-0.6, 0.2, 0.9)),
}
SKEW = AXES["skew"]
seeds = st.integers(0, 2**32 - 1)
every_kind = pytest.mark.parametrize("kind", KINDS)
every_axis = pytest.mark.parametrize("axes", AXES.values(), ids=list(AXES))
on_the_ground = pytest.mark.parametrize("fixed", [False, True], ids=["bodies", "ground"])


def moved(mechanism, q, v, a=0.0):
    """Configurations (1, nq) after a time t at a velocity and an acceleration."""
    return lambda t: pin.integrate(mechanism.model, q[0], v * t + a * t**2 / 2)[None]


def at_closed(mechanism, kind, axes, generator):
    return at_relative(mechanism, allowed(kind, axes, generator), generator)


def near(mechanism, kind, axes, generator):
    """A configuration well within half a turn from at_closed, where rows of turns are smooth."""
    step = generator.uniform(-0.9, 0.9, size=(2, 3))
    relative = allowed(kind, axes, generator) * pin.SE3(pin.exp3(step[0]), step[1])
    return at_relative(mechanism, relative, generator)


def drawn(mechanism, generator, count):
    return generator.uniform(-1, 1, size=(count, mechanism.model.nv))


@pytest.mark.parametrize("place", [at_closed, near])
@on_the_ground
@every_axis
@pytest.mark.parametrize("kind", [*KINDS, "cable"])
@settings(max_examples=2)
@given(seed=seeds)
def test_derivatives_are_those_of_the_residual(kind, axes, fixed, place, rate, seed):
    generator, pair = np.random.default_rng(seed), free_pair(kind, axes, fixed)
    q = place(pair, kind, axes, generator)
    v, a = drawn(pair, generator, 2)
    A = constraint_jacobian(pair, q)[0]
    speed = rate(lambda t: constraint_residual(pair, moved(pair, q, v)(t))[0])
    np.testing.assert_allclose(A @ v, speed, atol=1e-9)

    def turning(t):
        return rate(lambda s: constraint_residual(pair, moved(pair, q, v, a)(t + s))[0])

    drift = constraint_drift(pair, q, v[None])[0]
    np.testing.assert_allclose(A @ a + drift, rate(turning), atol=1e-6)


@on_the_ground
@every_axis
@every_kind
@settings(max_examples=3)
@given(seed=seeds)
def test_a_closure_allows_the_motions_of_its_joint_and_no_others(kind, axes, fixed, seed):
    generator, pair = np.random.default_rng(seed), free_pair(kind, axes, fixed)
    q = at_closed(pair, kind, axes, generator)
    assert np.abs(constraint_residual(pair, q)).max() < 1e-14
    # As many equations as freedoms lost, all independent: around here there is nothing else.
    assert np.linalg.matrix_rank(constraint_jacobian(pair, q)[0]) == ROWS[kind]


@every_axis
@every_kind
def test_wherever_the_rows_vanish_the_joint_is_closed(kind, axes):
    generator, pair = np.random.default_rng(3), free_pair(kind, axes)
    starts = np.concatenate([at_random(pair, generator) for _ in range(30)])
    q, gap = close_loops(pair, starts)
    assert (gap < 1e-12).sum() > 25
    found = [violation(kind, axes, relative_pose(pair, one)) for one in q[gap < 1e-12]]
    assert max(found) < 1e-10


@pytest.mark.parametrize("kind", ["hinge", "cylindrical"])
def test_axes_that_point_against_each_other_are_no_solution(kind):
    pair = free_pair(kind, SKEW)
    generator = np.random.default_rng(0)
    away = allowed(kind, (SKEW[0], tuple(-x for x in SKEW[1])), generator)
    tilt = pin.SE3(pin.exp3(np.array([1e-3, 0, 0])), np.zeros(3))
    residual = constraint_residual(pair, at_relative(pair, away * tilt, generator))
    assert np.linalg.norm(residual) > 100


@pytest.mark.parametrize("kind", ["hinge", "cylindrical"])
@given(angle=st.floats(0, 3))
def test_the_residual_of_an_axis_grows_with_its_angle(kind, angle):
    generator, pair = np.random.default_rng(1), free_pair(kind, (SKEW[0], SKEW[0]))
    across = np.cross(SKEW[0], [1.0, 0, 0])
    relative = pin.SE3(pin.exp3(angle * across / np.linalg.norm(across)), np.zeros(3))
    residual = constraint_residual(pair, at_relative(pair, relative, generator))
    assert np.linalg.norm(residual) == pytest.approx(2 * np.tan(angle / 2), abs=1e-12)


def test_the_row_of_a_rod_is_its_elongation_in_metres():
    pair, generator = free_pair("distance"), np.random.default_rng(2)
    longer = pin.SE3(np.eye(3), (ROD + 1e-6) * np.array([0.6, 0, 0.8]))
    residual = constraint_residual(pair, at_relative(pair, longer, generator))
    assert residual[0, 0] == pytest.approx(1e-6, rel=1e-5)


@on_the_ground
@pytest.mark.parametrize("kind", ["3d", "6d"])
@given(seed=seeds)
def test_pinocchios_own_closures_allow_the_same_motions(kind, fixed, seed):
    generator, pair = np.random.default_rng(seed), free_pair(kind, fixed=fixed)
    q = at_closed(pair, kind, AXES["z"], generator)
    motions = null_space(constraint_jacobian(pair, q)[0])
    theirs = pinocchio_loops.jacobian(pair, q[0])
    assert motions.shape[1] == 12 - np.linalg.matrix_rank(theirs)
    assert np.abs(theirs @ motions).max() < 1e-13


def test_an_unknown_kind_of_closure_is_refused_with_the_valid_ones(knee):
    with pytest.raises(OptionError, match=r"unknown kind of closure 'screw'.*3d, 6d, hinge"):
        replace(knee.closures[0], kind="screw")


def test_a_new_kind_of_closure_is_one_entry():
    # A ball that slides along an axis of one frame, and keeps its own axis across it.
    kind = ClosureKind(
        lambda closure: (*CLOSURE_KINDS["2d"].equations(closure), RightAngle(*closure.axes))
    )
    CLOSURE_KINDS.register("slot", kind)
    pair, generator = free_pair("slot", AXES["skew"]), np.random.default_rng(4)
    q, v = at_random(pair, generator), generator.uniform(-1, 1, size=12)
    assert pair.rows == 3
    residual = constraint_residual(pair, q)
    ahead = constraint_residual(pair, moved(pair, q, v)(1e-6))
    speed = constraint_jacobian(pair, q)[0] @ v
    np.testing.assert_allclose((ahead - residual)[0] / 1e-6, speed, atol=1e-4)
