"""Closed-loop forward dynamics: how the robot accelerates under the forces of its motors.

The tree moves by M a + h = S τ + Aᵀ λ [Featherstone2008, ch. 8]. Projected by Gᵀ, which the
constraint forces do no work on, and with a = G ü + γ,

    (Gᵀ M G) ü = Gᵀ (S τ - h - M γ).

Both sides are regressors times parameters, so that any values do, even those that no body has.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, samples
from loopid.errors import SingularityError
from loopid.kinematics import ClosedMotion, Factorisation, closed_motion
from loopid.regressors import motion_regressor, standard_values, tree_regressor
from loopid.robot import Mechanism

# Inertias below this fraction of the robot's largest are round-off.
LEAST_INERTIA = 1e-14
# Part of the forces that no acceleration balances, above which they are refused.
UNBALANCED = 1e-6


@checked
def forward_dynamics(
    mechanism: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    forces: FloatArray,
    standard_parameters: FloatArray | None = None,
) -> ClosedMotion:
    """Accelerations of all coordinates from the forces of the motors.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    velocities : FloatArray
        (N, dof) of the independent coordinates, as in ``closed_motion``.
    forces : FloatArray
        (N, m) of the motors in N or N m, in the order of ``mechanism.actuated``: also of those
        beyond the degrees of freedom. Free coordinates have none.
    standard_parameters : FloatArray, optional
        (n,) of ``mechanism.parameters()``; by default those of the robot file.

    Returns
    -------
    ClosedMotion
        Coordinates that no mass resists, such as the spin of a rod without inertia, do not
        accelerate.

    Raises
    ------
    SingularityError
        Where the motors do not determine the motion, or a force acts where no mass resists.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> robot = loopid.load_mechanism("five_bar")
    >>> K, masses = loopid.gravity_regressor(robot, robot.reference), robot.standard_parameters
    >>> forces = K @ masses("gravity")  # that hold it
    >>> motion = loopid.forward_dynamics(robot, robot.reference, np.zeros(2), forces)
    >>> bool(np.abs(motion.accelerations).max() < 1e-9)
    True
    """
    pi = standard_values(mechanism, standard_parameters)
    q = samples(configurations, mechanism.model.nq, "configurations")
    rates = samples(velocities, len(mechanism.independent), "velocities", len(q))
    motion = closed_motion(mechanism, q, rates, np.zeros_like(rates))
    motors = mechanism.velocity_indices(mechanism.actuated)
    tau = samples(forces, len(motors), "forces", len(q))
    driving = np.einsum("nji,nj->ni", motion.projection.G[:, motors], tau)  # Gᵀ S τ
    left = driving - motion_regressor(mechanism, motion) @ pi
    accelerations = _balanced(mechanism, closed_inertia(mechanism, motion, pi), left)
    steps = np.einsum("nij,nj->ni", motion.projection.G, accelerations)
    return replace(motion, accelerations=motion.gamma + steps)


def closed_inertia(mechanism: Mechanism, motion: ClosedMotion, pi: FloatArray) -> FloatArray:
    """Inertia matrices Gᵀ M G (N, dof, dof), column by column what an acceleration costs."""
    G, q = motion.projection.G, motion.configurations
    still = np.zeros(G.shape[:2])
    gravity = tree_regressor(mechanism, q) @ pi
    columns = [
        tree_regressor(mechanism, q, still, G[:, :, k]) @ pi - gravity for k in range(G.shape[2])
    ]
    return motion.projected(np.stack(columns, axis=2))


def _balanced(mechanism: Mechanism, inertia: FloatArray, forces: FloatArray) -> FloatArray:
    """Independent accelerations (N, dof), solved with inertias of comparable size."""
    own = np.abs(np.einsum("nii->ni", inertia))
    most = own.max(axis=1, initial=np.finfo(float).tiny, keepdims=True)
    scales = 1.0 / np.sqrt(np.where(own > LEAST_INERTIA * most, own, most))
    matrix = scales[:, :, None] * inertia * scales[:, None, :]
    target = scales * forces
    solution = Factorisation.of(matrix).solve(target[:, :, None])
    left = np.abs(target - (matrix @ solution)[:, :, 0])
    most = left.max(axis=1, initial=0.0)
    lost = np.flatnonzero(most > UNBALANCED * np.abs(target).max(axis=1, initial=0.0))
    if len(lost):
        name = mechanism.independent[int(left[lost[0]].argmax())]
        raise SingularityError(
            f"sample {lost[0]}: a force acts on {name}, but no mass resists it "
            f"({len(lost)} such samples)"
        )
    return np.asarray(scales * solution[:, :, 0], dtype=np.float64)
