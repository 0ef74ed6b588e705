"""How the robot moves: waypoints, motion files, Fourier series, and what all joints do then."""

from loopid.trajectories.filtering import LowPass, differentiate
from loopid.trajectories.fourier import FourierSeries
from loopid.trajectories.joint_motion import JointMotion, joint_motion
from loopid.trajectories.motion import Motion
from loopid.trajectories.program import MotionProgram, PlannedMotion, read_motion_program
from loopid.trajectories.recorded import read_reference
from loopid.trajectories.review import JointRange, MotionReview, review_motion
from loopid.trajectories.waypoints import Arc, Waypoint, point_to_point

__all__ = [
    "Arc",
    "FourierSeries",
    "JointMotion",
    "JointRange",
    "LowPass",
    "Motion",
    "MotionProgram",
    "MotionReview",
    "PlannedMotion",
    "Waypoint",
    "differentiate",
    "joint_motion",
    "point_to_point",
    "read_motion_program",
    "read_reference",
    "review_motion",
]
