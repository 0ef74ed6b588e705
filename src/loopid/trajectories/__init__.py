"""How the robot moves: waypoints, Fourier series, and what all joints do meanwhile."""

from loopid.trajectories.filtering import LowPass, differentiate
from loopid.trajectories.fourier import FourierSeries
from loopid.trajectories.joint_motion import JointMotion, joint_motion
from loopid.trajectories.motion import Motion
from loopid.trajectories.review import JointRange, MotionReview, review_motion
from loopid.trajectories.waypoints import Arc, Waypoint, point_to_point

__all__ = [
    "Arc",
    "FourierSeries",
    "JointMotion",
    "JointRange",
    "LowPass",
    "Motion",
    "MotionReview",
    "Waypoint",
    "differentiate",
    "joint_motion",
    "point_to_point",
    "review_motion",
]
