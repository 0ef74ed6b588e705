from .files import (
    MotionProgram as MotionProgram,
    PlannedMotion as PlannedMotion,
    read_motion_program as read_motion_program,
    read_reference as read_reference,
)
from .filtering import LowPass as LowPass, differentiate as differentiate
from .joints import (
    JointMotion as JointMotion,
    JointRange as JointRange,
    MotionReview as MotionReview,
    joint_motion as joint_motion,
    review_motion as review_motion,
    review_program as review_program,
)
from .simulation import (
    Noise as Noise,
    log_text as log_text,
    scaled_bodies as scaled_bodies,
    simulate_log as simulate_log,
    simulate_measurement as simulate_measurement,
)
from .trajectories import (
    Arc as Arc,
    Curve as Curve,
    FourierCurve as FourierCurve,
    FourierSeries as FourierSeries,
    Motion as Motion,
    SplineCurve as SplineCurve,
    Waypoint as Waypoint,
    point_to_point as point_to_point,
)
