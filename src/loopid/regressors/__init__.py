"""What the motion weighs: closed-loop regressors, stacked observations."""

from loopid.observation import Observation
from loopid.regressors.closed_loop import (
    ForceParts,
    dynamic_regressor,
    force_parts,
    gravity_regressor,
    motion_parameters,
    motion_regressor,
    standard_values,
)
from loopid.regressors.joint_terms import (
    JOINT_TERMS,
    NO_TERMS,
    OF_FILE,
    FileForce,
    JointState,
    JointTerm,
    JointTerms,
    file_forces,
    joint_term,
    warn_of_omitted,
)
from loopid.regressors.structural import structural_observation
