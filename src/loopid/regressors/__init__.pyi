from .closed_loop import (
    ClosedLoop as ClosedLoop,
    ForceParts as ForceParts,
    dynamic_regressor as dynamic_regressor,
    force_parts as force_parts,
    gravity_regressor as gravity_regressor,
    motion_parameters as motion_parameters,
    motion_regressor as motion_regressor,
)
from .joint_laws import (
    JOINT_TERMS as JOINT_TERMS,
    JointState as JointState,
    JointTerm as JointTerm,
    PriorGroup as PriorGroup,
    length_term as length_term,
)
from .joint_terms import (
    FileForce as FileForce,
    JointTerms as JointTerms,
    file_forces as file_forces,
)
from .structural import structural_observation as structural_observation
