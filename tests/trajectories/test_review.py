"""A review finds exactly the limits that a motion breaks."""

import numpy as np
import pytest

from loopid import platform_coordinates
from loopid.errors import OptionError
from loopid.trajectories import Waypoint, joint_motion, point_to_point, review_motion


def lifted(mechanism, height):
    """Up by a height and back."""
    start = platform_coordinates(mechanism, mechanism.reference[None])[0]
    top = start + np.array([0, height, 0, 0])
    ways = [Waypoint(top, 1.0), Waypoint(start, 1.0)]
    return joint_motion(mechanism, point_to_point(mechanism.platform.names, start, ways, 50.0))


def test_a_small_motion_is_fit_to_be_run(mechanism):
    review = review_motion(mechanism, lifted(mechanism, 0.02))
    assert review.problems == ()
    assert {r.joint for r in review.ranges} == set(mechanism.joints)
    assert all(r.lowest <= r.highest and r.clearance >= 0 for r in review.ranges)
    assert all(speed > 0 for speed in review.speeds.values())


def test_every_stroke_beyond_its_limit_is_named(mechanism):
    motion = lifted(mechanism, 0.35)
    review = review_motion(mechanism, motion)
    strokes = motion.configurations[:, [mechanism.joints.index(j) for j in mechanism.actuated]]
    upper = mechanism.model.upperPositionLimit[
        [mechanism.joints.index(j) for j in mechanism.actuated]
    ]
    outside = {j for j, far in zip(mechanism.actuated, strokes.max(0) > upper, strict=True) if far}
    assert outside
    named = {text.split()[1] for text in review.problems if text.startswith("joint")}
    assert named & set(mechanism.actuated) == outside


def test_the_margin_decides_about_the_singularity(mechanism):
    motion = lifted(mechanism, 0.02)
    least = motion.singularity.min()
    assert review_motion(mechanism, motion, 0.99 * least).problems == ()
    (problem,) = review_motion(mechanism, motion, 1.01 * least).problems
    assert "singularity" in problem
    when = review_motion(mechanism, motion).singular_time
    assert motion.singularity[np.flatnonzero(motion.time == when)] == least


def test_a_negative_margin_is_refused(mechanism):
    with pytest.raises(OptionError, match="margin"):
        review_motion(mechanism, lifted(mechanism, 0.02), -1.0)
