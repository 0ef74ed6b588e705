"""The closed-loop regressor: tree columns projected to independent coordinates, K = Gᵀ Y."""

from __future__ import annotations

from loopid.arrays import FloatArray
from loopid.kinematics import closed_motion, project
from loopid.mechanism import Mechanism
from loopid.regressors.motion import motion_regressor
from loopid.regressors.tree import tree_regressor


def gravity_regressor(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Actuator forces at rest per unit of mass and first moment.

    The forces that hold the robot against gravity are K π with π =
    ``mechanism.standard_parameters("gravity")``; the paper's K_G.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.

    Returns
    -------
    FloatArray
        (N, dof, n), rows in the order of ``mechanism.independent``.
    """
    G = project(mechanism, configurations).G
    return G.transpose(0, 2, 1) @ tree_regressor(mechanism, configurations, model="gravity")


def dynamic_regressor(
    mechanism: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    accelerations: FloatArray,
) -> FloatArray:
    """Actuator forces in motion per unit of all ten parameters a body.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    velocities, accelerations : FloatArray
        (N, dof) of the independent coordinates; those of the others follow, v = G u̇, a = G ü + γ.

    Returns
    -------
    FloatArray
        (N, dof, n), rows in the order of ``mechanism.independent``.
    """
    motion = closed_motion(mechanism, configurations, velocities, accelerations)
    return motion_regressor(mechanism, motion)
