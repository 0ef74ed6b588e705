"""Regressors of configurations and motions that are known: K = Gᵀ Y.

Y(q, v, a) π are the joint forces of the open tree for the parameters π of all bodies. The motion
that the loops allow, v = G u̇ and a = G ü + γ, does work with Gᵀ of them only. At rest, v = a = 0,
with the columns m, mx, my, mz of Y, Gᵀ Y is the paper's K_G. ``Dynamics`` assembles the motion too.
"""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, checked, one_as_many, samples
from loopid.kinematics.poses import torque_regressors
from loopid.kinematics.projection import ClosedMotion, project
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.regressors.dynamics import Dynamics
from loopid.regressors.joint_terms import JointTerms
from loopid.regressors.maxwell_slip import Slips
from loopid.robot.robot import Robot


@checked
@one_as_many
def gravity_regressor(robot: Robot, configurations: FloatArray) -> FloatArray:
    """Actuator forces at rest per unit of mass and first moment.

    The forces that hold the robot against gravity are K π with π =
    ``robot.standard_parameters("gravity")``; the paper's K_G.

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (nq,) or (N, nq), closed.

    Returns
    -------
    FloatArray
        (dof, n) or (N, dof, n), rows in the order of ``robot.independent``.

    Raises
    ------
    DataError, SingularityError
        As ``project``.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("3ups_rpu")
    >>> loopid.regressors.gravity_regressor(robot, robot.reference).shape
    (4, 36)
    """
    q = samples(configurations, robot.model.nq, "configurations")
    return torque_regressors(robot, q, model="gravity", G=project(robot, q).G)


def motion_parameters(
    robot: Robot, model: str = "full", joint_terms: JointTerms | None = None
) -> ParameterSet:
    """Names of the columns of ``motion_regressor``."""
    bodies = robot.parameters(model)
    return bodies if joint_terms is None else bodies + joint_terms.parameters(robot)


@checked
def motion_regressor(
    robot: Robot,
    motion: ClosedMotion,
    model: str = "full",
    *,
    joint_terms: JointTerms | None = None,
    standard_parameters: FloatArray | None = None,
    slips: Slips | None = None,
) -> FloatArray:
    """Actuator forces per unit of the parameters of all bodies, then of joint terms.

    ``motion_parameters`` names the columns.

    Parameters
    ----------
    robot : Robot
    motion : ClosedMotion
        Of N samples.
    model : str
        ``"full"``, or ``"gravity"`` for what holds the robot at rest in each configuration; joint
        terms are those of the motion in either.
    joint_terms : JointTerms, optional
    standard_parameters : FloatArray, optional
        (n,) of the full model, of the bodies that load joints; by default the robot file's.
    slips : mapping, optional
        ``JointTerms.slips`` of the whole motion, for hysteresis; by default friction is that of
        steady motion.

    Returns
    -------
    FloatArray
        (N, dof, n).

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load("five_bar")
    >>> rest = loopid.kinematics.closed_motion(robot, robot.reference, np.zeros(2), np.zeros(2))
    >>> loopid.regressors.motion_regressor(robot, rest).shape
    (1, 2, 40)
    """
    q, G = motion.configurations, motion.projection.G
    rates = (motion.velocities, motion.accelerations) if model == "full" else ()
    bodies = torque_regressors(robot, q, *rates, model=model, G=G)
    if joint_terms is None:
        return bodies
    columns = joint_terms.columns(robot, motion, standard_parameters, slips=slips)
    return np.concatenate([bodies, columns], axis=2)


@record
class ForceParts:
    """Parts of the actuator forces, each (dof,) or (N, dof) in N or N m."""

    inertial: FloatArray  # linear in the accelerations of the independent coordinates
    coriolis: FloatArray  # quadratic in their velocities, through the tree's own terms and γ
    gravity: FloatArray  # what holds the robot at rest

    @property
    def total(self) -> FloatArray:
        """Their sum."""
        return self.inertial + self.coriolis + self.gravity


@checked
def force_parts(
    robot: Robot,
    configurations: FloatArray,
    velocities: FloatArray,
    accelerations: FloatArray,
    *,
    standard_parameters: FloatArray | None = None,
) -> ForceParts:
    """Split the actuator forces of a motion by their cause.

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (nq,) or (N, nq), closed.
    velocities, accelerations : FloatArray
        (dof,) or (N, dof) of the independent coordinates.
    standard_parameters : FloatArray, optional
        (n,) of ``robot.parameters()``; by default those of the robot file.

    Returns
    -------
    ForceParts

    Raises
    ------
    DataError, SingularityError
        As ``closed_motion``.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> robot = loopid.load("five_bar")
    >>> parts = loopid.regressors.force_parts(robot, robot.reference, np.zeros(2), np.zeros(2))
    >>> bool(np.allclose(parts.total, parts.gravity))
    True
    """
    dynamics, still = Dynamics(robot, standard_parameters), np.zeros_like(velocities)
    pose = dynamics.pose(q=configurations)
    gravity, moving, whole = (
        dynamics.inverse(pose, *rates)
        for rates in ((), (velocities, still), (velocities, accelerations))
    )
    return ForceParts(whole - moving, moving - gravity, gravity)
