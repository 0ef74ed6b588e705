"""Motions, plans and curves are values: they compare, hash, copy and pickle."""

import copy
import pickle

import numpy as np
import pytest

import loopid
from loopid.motion import Waypoint
from loopid.motion.joints import JointRange
from loopid.motion.trajectories import Arc, FourierCurve


def values():
    robot = loopid.load("four_bar")
    series = loopid.motion.FourierSeries(robot.actuated, 0.5, [1.0], [[0.2]], [[0.0]])
    motion = series.motion(rate=20.0)
    followed = loopid.motion.joint_motion(robot, motion)
    curve = FourierCurve(np.zeros((4, 2)))
    program = loopid.motion.read_motion_program("five_bar")
    yield from (series, motion, followed, loopid.motion.review_motion(robot, followed))
    yield from (
        loopid.simulate(robot, followed),
        loopid.motion.Noise(1.0),
        loopid.motion.LowPass(2.0),
    )
    yield from (curve, Arc("x", 0.1), JointRange("a", 0, 1, -1, 2))
    yield loopid.motion.LowPass(2.0)
    yield Waypoint([0.0, 1.0], 2.0, (Arc("x", 0.1),), curve)
    yield from (program, program.plans[0])


BOTH = [*zip(values(), values(), strict=True)]


@pytest.mark.parametrize(("one", "again"), BOTH, ids=[type(one).__name__ for one, _ in BOTH])
def test_records_of_motions_compare_hash_copy_and_pickle(one, again):
    assert one == again
    assert hash(one) == hash(again)
    for other in (pickle.loads(pickle.dumps(one)), copy.copy(one), copy.deepcopy(one)):
        assert other == one
        assert hash(other) == hash(one)
    assert len(repr(one).splitlines()) <= 10


def test_motions_that_differ_are_not_equal():
    series = loopid.motion.FourierSeries(("a",), 0.5, [1.0], [[0.2]], [[0.0]])
    assert series.motion(rate=20.0) != series.motion(rate=21.0)
    assert FourierCurve(np.zeros((2, 1))) != FourierCurve(np.zeros((2, 2)))


@pytest.mark.parametrize("seed", range(3))
def test_a_curve_backwards_is_the_same_way_from_its_end(seed):
    shape = np.random.default_rng(seed).normal(size=(4, 2))
    shape = shape[[0, 0, 1, 1]] * np.array([[2.0], [-1.0], [4.0], [-1.0]])  # at rest at its ends
    curve, time = FourierCurve(shape), np.linspace(0.0, 3.0, 31)
    there, back = curve.detour(3.0 - time, 3.0), curve.backwards().detour(time, 3.0)
    signs = np.array([1.0, -1.0, 1.0])[:, None, None]  # of position, rate and acceleration
    np.testing.assert_allclose(back, signs * there, atol=1e-11)
    assert not np.allclose(curve.detour(time, 3.0), there)
