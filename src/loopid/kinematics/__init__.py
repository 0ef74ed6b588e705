"""Where the robot can be: closures, assembly, projection, random closed configurations."""

from loopid.kinematics.accuracy import (
    Accuracy,
    geometry_accuracy,
    nearly_equal_lengths,
    same_motion,
    within_accuracy,
)
from loopid.kinematics.assembly import CLOSURE_TOLERANCE, Assembly, assemble, try_assemble
from loopid.kinematics.closing import (
    close_by_continuation,
    close_loops,
    displaced,
    nearby_configurations,
)
from loopid.kinematics.constraint import (
    constraint_drift,
    constraint_jacobian,
    constraint_residual,
    largest_residual,
    scaled_constraint,
)
from loopid.kinematics.measured import (
    JointCoordinates,
    MeasuredCoordinates,
    measured_coordinates,
    platform_coordinates,
    platform_motion,
)
from loopid.kinematics.mobility import Mobility, independent_coordinates, mobility
from loopid.kinematics.modes import FOLDED, assembly_modes
from loopid.kinematics.poses import (
    FrameMotions,
    FramePoses,
    difference,
    frame_motions,
    frame_poses,
    integrate,
    torque_regressors,
)
from loopid.kinematics.projection import (
    NEAR_SINGULARITY,
    ClosedMotion,
    Factorisation,
    Projection,
    closed_motion,
    null_space,
    partition,
    project,
    singularity_measure,
)
from loopid.kinematics.sampling import (
    DEFAULT_MARGIN,
    configuration_batches,
    random_configurations,
    random_motions,
)

__all__ = [
    "CLOSURE_TOLERANCE",
    "DEFAULT_MARGIN",
    "FOLDED",
    "NEAR_SINGULARITY",
    "Accuracy",
    "Assembly",
    "ClosedMotion",
    "Factorisation",
    "FrameMotions",
    "FramePoses",
    "JointCoordinates",
    "MeasuredCoordinates",
    "Mobility",
    "Projection",
    "assemble",
    "assembly_modes",
    "close_by_continuation",
    "close_loops",
    "closed_motion",
    "configuration_batches",
    "constraint_drift",
    "constraint_jacobian",
    "constraint_residual",
    "difference",
    "displaced",
    "frame_motions",
    "frame_poses",
    "geometry_accuracy",
    "independent_coordinates",
    "integrate",
    "largest_residual",
    "measured_coordinates",
    "mobility",
    "nearby_configurations",
    "nearly_equal_lengths",
    "null_space",
    "partition",
    "platform_coordinates",
    "platform_motion",
    "project",
    "random_configurations",
    "random_motions",
    "same_motion",
    "scaled_constraint",
    "singularity_measure",
    "torque_regressors",
    "try_assemble",
    "within_accuracy",
]
