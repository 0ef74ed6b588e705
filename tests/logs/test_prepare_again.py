"""A recording prepared again: the same part of the log, filtered otherwise."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid.logs import FilterOptions, Recording
from loopid.logs.preparing import prepare_again
from loopid.motion import JointMotion


@pytest.fixture(scope="module")
def recording(load_once):
    robot = load_once("five_bar")
    sine, cosine = 0.1 * np.random.default_rng(0).normal(size=(2, 2, 4))
    series = loopid.motion.FourierSeries(robot.actuated, 0.2, np.array([1.7, 0.7]), sine, cosine)
    run = loopid.simulate(
        robot, loopid.motion.joint_motion(robot, series.motion(duration=10.0, rate=100.0))
    )
    log = loopid.Log.from_arrays(run.time, run.position, run.force, robot.actuated)
    log = replace(log, checked=True)  # its limits are no matter
    return robot, loopid.prepare(robot, log, filter=FilterOptions(cutoff=10.0))


def test_the_same_filter_gives_the_same_samples(recording):
    robot, whole = recording
    for part in (whole, *whole.split(0.6), whole.between(2.0, 5.0)):
        (again,) = prepare_again(robot, [part])
        assert np.array_equal(again.force, part.force)
        assert np.array_equal(again.motion.time, part.motion.time)


@pytest.mark.parametrize("cutoff", [2.0, 3.3, 9.0, 15.0])
def test_parts_stay_apart_and_together_are_the_whole(recording, cutoff):
    robot, whole = recording
    *parts, again = prepare_again(robot, [*whole.split(0.6), whole], cutoff=cutoff)
    times = np.concatenate([part.motion.time for part in parts])
    assert np.array_equal(times, again.motion.time)
    assert all(part.cutoff == cutoff for part in parts)


@pytest.mark.parametrize("rows", [slice(None), slice(None, None, -1), slice(5, 6)])
def test_a_known_motion_changes_nothing(recording, rows):
    """Of another filter, backwards, or of one sample: loops only start elsewhere."""
    robot, whole = recording
    other = prepare_again(robot, [whole], cutoff=4.0)[0].motion
    time, q = other.time[rows], other.configurations[rows]
    rates = np.zeros((len(time), 2))
    known = JointMotion(np.sort(time), q, rates, rates, np.ones(len(time)))
    found = loopid.prepare(robot, whole.log, filter=whole.filter, known=known)
    np.testing.assert_array_equal(found.motion.time, whole.motion.time)
    for part in ("configurations", "velocities", "accelerations", "singularity"):
        ours, theirs = getattr(found.motion, part), getattr(whole.motion, part)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


def test_an_exact_motion_stays_as_it_is(recording):
    robot, whole = recording
    exact = Recording.of_motion(whole.motion, whole.force, robot.actuated)
    assert prepare_again(robot, [exact], cutoff=2.0)[0] is exact
