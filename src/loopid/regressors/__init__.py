"""What the motion weighs: tree and closed-loop regressors, stacked observations."""

from loopid.observation import Observation
from loopid.regressors.closed_loop import dynamic_regressor, gravity_regressor
from loopid.regressors.joint_terms import JOINT_KINDS, JointTerms
from loopid.regressors.motion import motion_parameters, motion_regressor
from loopid.regressors.parts import ForceParts, force_parts
from loopid.regressors.structural import structural_observation
from loopid.regressors.tree import tree_regressor

__all__ = [
    "JOINT_KINDS",
    "ForceParts",
    "JointTerms",
    "Observation",
    "dynamic_regressor",
    "force_parts",
    "gravity_regressor",
    "motion_parameters",
    "motion_regressor",
    "structural_observation",
    "tree_regressor",
]
