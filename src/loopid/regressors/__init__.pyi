from .dynamics import Dynamics as Dynamics, Pose as Pose
from .joint_laws import JOINT_TERMS as JOINT_TERMS, JointState as JointState, JointTerm as JointTerm
from .joint_terms import JointTerms as JointTerms
from .motion_regressors import (
    force_parts as force_parts,
    gravity_regressor as gravity_regressor,
    motion_regressor as motion_regressor,
)
from .structural import structural_observation as structural_observation
