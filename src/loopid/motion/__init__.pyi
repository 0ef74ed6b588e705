from .files import (
    MotionProgram as MotionProgram,
    PlannedMotion as PlannedMotion,
    read_motion_program as read_motion_program,
)
from .filtering import LowPass as LowPass
from .joints import (
    JointMotion as JointMotion,
    joint_motion as joint_motion,
    review_motion as review_motion,
)
from .simulation import (
    Measurement as Measurement,
    Noise as Noise,
    scaled_bodies as scaled_bodies,
    simulate as simulate,
)
from .trajectories import (
    FourierSeries as FourierSeries,
    Motion as Motion,
    Waypoint as Waypoint,
    point_to_point as point_to_point,
)
