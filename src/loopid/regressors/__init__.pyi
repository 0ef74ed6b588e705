from .dynamics import Dynamics as Dynamics, Pose as Pose
from .file_forces import FileForce as FileForce, file_forces as file_forces
from .joint_laws import (
    JOINT_TERMS as JOINT_TERMS,
    JointState as JointState,
    JointTerm as JointTerm,
    PriorGroup as PriorGroup,
    length_term as length_term,
)
from .joint_terms import JointTerms as JointTerms
from .motion_regressors import (
    ForceParts as ForceParts,
    dynamic_regressor as dynamic_regressor,
    force_parts as force_parts,
    gravity_regressor as gravity_regressor,
    motion_parameters as motion_parameters,
    motion_regressor as motion_regressor,
)
from .structural import structural_observation as structural_observation
