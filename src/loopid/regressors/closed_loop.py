"""The closed-loop regressor: tree columns projected to the actuated joints, K = Gᵀ Y."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, samples
from loopid.kinematics import project
from loopid.mechanism import Mechanism
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
        (N, dof, n), rows in the order of ``mechanism.actuated``.
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
        (N, dof) of the actuated joints; those of the others follow, v = G u̇, a = G ü + γ.

    Returns
    -------
    FloatArray
        (N, dof, n), rows in the order of ``mechanism.actuated``.
    """
    projection = project(mechanism, configurations, velocities)
    assert projection.gamma is not None
    G, dof = projection.G, len(projection.independent)
    v = np.einsum("nij,nj->ni", G, samples(velocities, dof, "velocities", len(G)))
    a = np.einsum("nij,nj->ni", G, samples(accelerations, dof, "accelerations", len(G)))
    Y = tree_regressor(mechanism, configurations, v, a + projection.gamma)
    return G.transpose(0, 2, 1) @ Y
