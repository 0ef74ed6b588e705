from .assembly import (
    Assembly as Assembly,
    AssemblyOptions as AssemblyOptions,
    assemble as assemble,
    closed_configurations as closed_configurations,
)
from .closing import displaced as displaced
from .constraint import (
    constraint_drift as constraint_drift,
    constraint_jacobian as constraint_jacobian,
    constraint_residual as constraint_residual,
)
from .freedoms import mobility as mobility
from .measured import (
    measured_coordinates as measured_coordinates,
    platform_coordinates as platform_coordinates,
)
from .poses import difference as difference, torque_regressors as torque_regressors
from .projection import (
    ClosedMotion as ClosedMotion,
    Projection as Projection,
    closed_motion as closed_motion,
    project as project,
)
from .reactions import bearing_forces as bearing_forces
from .rounding import Accuracy as Accuracy
from .sampling import (
    SamplingOptions as SamplingOptions,
    random_configurations as random_configurations,
    random_motions as random_motions,
)
