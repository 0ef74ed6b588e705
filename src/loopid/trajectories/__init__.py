"""How the robot moves: waypoints, motion files, Fourier series, and what all joints do then."""

from loopid.trajectories.filtering import LowPass, differentiate
from loopid.trajectories.joint_motion import (
    JointMotion,
    JointRange,
    MotionReview,
    joint_motion,
    review_motion,
)
from loopid.trajectories.motion import (
    Arc,
    Curve,
    FourierCurve,
    FourierSeries,
    Motion,
    SplineCurve,
    Waypoint,
    point_to_point,
)
from loopid.trajectories.motion_files import (
    MotionProgram,
    PlannedMotion,
    read_motion_program,
    read_reference,
)
