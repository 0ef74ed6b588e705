"""All joints follow a motion with closed loops, and a review says whether the robot may."""

import numpy as np
import pytest

from loopid.errors import AssemblyError, OptionError
from loopid.kinematics import constraint_residual, measured_coordinates, platform_coordinates
from loopid.motion import Waypoint, joint_motion, point_to_point, review_motion
from loopid.motion.trajectories import Arc

RATE = 500.0


@pytest.fixture
def platform_ways(mechanism):
    start = platform_coordinates(mechanism, mechanism.reference[None])[0]
    ways = [
        Waypoint(start + np.array([0.04, 0.02, 0.1, -0.15]), 0.8, (Arc("z_m", 0.01),)),
        Waypoint(start, 0.6),
    ]
    return point_to_point(mechanism.platform.names, start, ways, rate=RATE)


@pytest.fixture(params=["platform", "motors", "limb 4"])
def followed(request, mechanism, platform_ways):
    """The same motion, given by the platform, by the motors or by limb 4 and the platform."""
    by_platform = joint_motion(mechanism, platform_ways)
    if request.param == "platform":
        return by_platform
    limb_4 = ("leg4_revolute", "leg4_stroke", "platform_pitch", "platform_yaw")
    names = mechanism.actuated if request.param == "motors" else limb_4
    measured = measured_coordinates(mechanism, names)
    values = measured.read(by_platform.configurations.copy())
    start, end = values[0], values[len(values) // 2]
    return joint_motion(mechanism, point_to_point(names, start, [Waypoint(end, 0.9)], rate=RATE))


def test_the_loops_stay_closed(mechanism, followed):
    residual = constraint_residual(mechanism, followed.configurations)
    assert np.abs(residual).max() < 1e-10
    assert (followed.singularity > 0.01).all()


def test_motor_velocities_and_accelerations_are_derivatives(mechanism, followed):
    motors = measured_coordinates(mechanism).read(followed.configurations.copy())
    step = 1 / RATE
    velocity = (motors[2:] - motors[:-2]) / (2 * step)
    np.testing.assert_allclose(velocity, followed.velocities[1:-1], atol=1e-4)
    acceleration = (motors[2:] - 2 * motors[1:-1] + motors[:-2]) / step**2
    np.testing.assert_allclose(acceleration, followed.accelerations[1:-1], atol=2e-2)


def test_the_platform_goes_where_it_was_sent(mechanism, platform_ways):
    found = platform_coordinates(mechanism, joint_motion(mechanism, platform_ways).configurations)
    np.testing.assert_allclose(found, platform_ways.position, atol=1e-10)


def test_what_cannot_be_followed_is_refused(mechanism):
    start = measured_coordinates(mechanism).read(mechanism.reference[None].copy())[0]
    # One limb twice as long as the others together cannot meet them.
    far = Waypoint(start + np.array([10.0, 0, 0, 0]), 1.0)
    with pytest.raises(AssemblyError, match="cannot be assembled"):
        joint_motion(mechanism, point_to_point(mechanism.actuated, start, [far], rate=20.0))
    unknown = point_to_point(("elbow",), [0.0], [Waypoint([1.0], 1.0)])
    with pytest.raises(OptionError, match=r"elbow fits neither .*x_m.* nor joints"):
        joint_motion(mechanism, unknown)
    with pytest.raises(OptionError, match="singularity_threshold"):
        review_motion(mechanism, lifted(mechanism, 0.02), -1.0)


def lifted(mechanism, height):
    """Up by a height and back."""
    start = platform_coordinates(mechanism, mechanism.reference[None])[0]
    top = start + np.array([0, height, 0, 0])
    ways = [Waypoint(top, 1.0), Waypoint(start, 1.0)]
    return joint_motion(mechanism, point_to_point(mechanism.platform.names, start, ways, rate=50.0))


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
