"""Where the robot can be: closures, assembly, projection, random closed configurations."""

from loopid.kinematics.assembly import (
    CLOSURE_TOLERANCE,
    Assembly,
    JointCoordinates,
    assemble,
    measured_coordinates,
    platform_coordinates,
    platform_motion,
    try_assemble,
)
from loopid.kinematics.closing import (
    close_by_continuation,
    close_loops,
    displaced,
    nearby_configurations,
)
from loopid.kinematics.constraint import (
    Constraint,
    constraint_drift,
    constraint_jacobian,
    constraint_residual,
    largest_residual,
)
from loopid.kinematics.mobility import Mobility, independent_coordinates, mobility
from loopid.kinematics.modes import FOLDED, assembly_modes
from loopid.kinematics.poses import (
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
from loopid.kinematics.reactions import bearing_forces
from loopid.kinematics.rounding import (
    ROUND_OFF,
    SIX_DIGITS,
    Accuracy,
    changes,
    exact_geometry,
    geometry_accuracy,
    largest_gap,
    nearly_equal_lengths,
    nearly_special,
    rounding_that_closes,
    same_motion,
    within_accuracy,
)
from loopid.kinematics.sampling import (
    DEFAULT_MARGIN,
    configuration_batches,
    random_configurations,
    random_motions,
)
