"""The regressor of a motion: bodies and joint terms side by side."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.kinematics.motion import ClosedMotion
from loopid.parameters import ParameterSet, model_kinds
from loopid.regressors.closed_loop import moving_regressor, resting_regressor
from loopid.regressors.joint_terms import JointTerms
from loopid.robot import Mechanism


@checked
def motion_parameters(
    mechanism: Mechanism, model: str = "full", joint_terms: JointTerms | None = None
) -> ParameterSet:
    """Names of the columns of ``motion_regressor``."""
    bodies = mechanism.parameters(model)
    return bodies if joint_terms is None else bodies + joint_terms.parameters(mechanism)


@checked
def motion_regressor(
    mechanism: Mechanism,
    motion: ClosedMotion,
    model: str = "full",
    joint_terms: JointTerms | None = None,
) -> FloatArray:
    """Actuator forces per unit of the parameters of all bodies, then of the joint terms.

    Parameters
    ----------
    motion : ClosedMotion
    model : str
        ``"full"``, or ``"gravity"`` for what holds the robot at rest in each configuration.
    joint_terms : JointTerms, optional
        Of the motion, in either model.

    Returns
    -------
    FloatArray
        (N, dof, n), columns named by ``motion_parameters``.
    """
    if model_kinds(model) == model_kinds("full"):
        bodies = moving_regressor(mechanism, motion)
    else:
        bodies = resting_regressor(mechanism, motion.configurations, motion.projection.G)
    if joint_terms is None:
        return bodies
    return np.concatenate([bodies, joint_terms.columns(mechanism, motion)], axis=2)
