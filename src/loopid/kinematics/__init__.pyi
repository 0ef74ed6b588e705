from .assembly import (
    Assembly as Assembly,
    AssemblyOptions as AssemblyOptions,
    assemble as assemble,
    try_assemble as try_assemble,
)
from .closing import (
    ClosingOptions as ClosingOptions,
    ModeOptions as ModeOptions,
    assembly_modes as assembly_modes,
    close_by_continuation as close_by_continuation,
    close_loops as close_loops,
    displaced as displaced,
    nearby_configurations as nearby_configurations,
)
from .constraint import (
    constraint_drift as constraint_drift,
    constraint_jacobian as constraint_jacobian,
    constraint_residual as constraint_residual,
    largest_residual as largest_residual,
)
from .freedoms import (
    Mobility as Mobility,
    independent_coordinates as independent_coordinates,
    mobility as mobility,
)
from .loop_motion import (
    LoopDirections as LoopDirections,
    closed_nearby as closed_nearby,
    loop_motion as loop_motion,
)
from .measured import (
    JointCoordinates as JointCoordinates,
    measured_coordinates as measured_coordinates,
    platform_coordinates as platform_coordinates,
    platform_motion as platform_motion,
)
from .poses import (
    difference as difference,
    frame_motions as frame_motions,
    frame_poses as frame_poses,
    integrate as integrate,
    torque_regressors as torque_regressors,
)
from .projection import (
    NEAR_SINGULARITY as NEAR_SINGULARITY,
    ClosedMotion as ClosedMotion,
    Factorisation as Factorisation,
    Projection as Projection,
    closed_motion as closed_motion,
    null_space as null_space,
    partition as partition,
    project as project,
    singularity_measure as singularity_measure,
)
from .reactions import bearing_forces as bearing_forces
from .rounding import (
    Accuracy as Accuracy,
    geometry_accuracy as geometry_accuracy,
    within_accuracy as within_accuracy,
)
from .sampling import (
    SamplingOptions as SamplingOptions,
    random_configurations as random_configurations,
    random_motions as random_motions,
)
