"""Each kind of closure is zero exactly where its joint lets the two frames be."""

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
from hypothesis import given, settings
from hypothesis import strategies as st

import pinocchio_loops
from closure_robots import ROWS as CLOSURE_ROWS
from loopid.kinematics import (
    close_loops,
    constraint_drift,
    constraint_jacobian,
    constraint_residual,
    null_space,
)

AXES = {
    "z": ((0, 0, 1), (0, 0, 1)),
    "minus x": ((-1, 0, 0), (0, 1, 0)),
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


def closed(mechanism, kind, axes, generator):
    return at_relative(mechanism, allowed(kind, axes, generator), generator)


def near(mechanism, kind, axes, generator):
    """A configuration well within half a turn from closed, where rows of turns are smooth."""
    step = generator.uniform(-0.9, 0.9, size=(2, 3))
    relative = allowed(kind, axes, generator) * pin.SE3(pin.exp3(step[0]), step[1])
    return at_relative(mechanism, relative, generator)


def drawn(mechanism, generator, count):
    return generator.uniform(-1, 1, size=(count, mechanism.model.nv))


@pytest.mark.parametrize("place", [closed, near])
@on_the_ground
@every_axis
@every_kind
@settings(max_examples=8)
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
@settings(max_examples=5)
@given(seed=seeds)
def test_a_closure_allows_the_motions_of_its_joint_and_no_others(kind, axes, fixed, seed):
    generator, pair = np.random.default_rng(seed), free_pair(kind, axes, fixed)
    q = closed(pair, kind, axes, generator)
    assert np.abs(constraint_residual(pair, q)).max() < 1e-14
    # As many equations as freedoms lost, all independent: around here there is nothing else.
    assert np.linalg.matrix_rank(constraint_jacobian(pair, q)[0]) == CLOSURE_ROWS[kind]


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
    q = closed(pair, kind, AXES["z"], generator)
    motions = null_space(constraint_jacobian(pair, q)[0])
    theirs = pinocchio_loops.jacobian(pair, q[0])
    assert motions.shape[1] == 12 - np.linalg.matrix_rank(theirs)
    assert np.abs(theirs @ motions).max() < 1e-13
