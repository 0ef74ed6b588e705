"""The closed-loop regressor: what the bodies ask of the independent coordinates, K = Gᵀ Y."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray, samples
from loopid.kinematics import ClosedMotion
from loopid.kinematics.blocks import in_blocks
from loopid.kinematics.layout import joint_layout
from loopid.kinematics.projected_blocks import BlockProjection, Partition, in_projected_blocks
from loopid.kinematics.tree import tree_motion, tree_pose
from loopid.regressors.bodies import moving_columns, resting_columns
from loopid.regressors.tree import tree_regressor
from loopid.robot import Mechanism
from loopid.robot.identical import tie_indices


@checked
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
    q = samples(configurations, mechanism.model.nq, "configurations")
    places = _places(mechanism)

    def columns(block: BlockProjection, _: slice) -> tuple[FloatArray, ...]:
        return (_tied(mechanism, resting_columns(block.pose.tree, places, block.G)),)

    width = _width(mechanism, "gravity")
    return in_projected_blocks(mechanism, q, Partition(mechanism), columns, width)[0]


@checked
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
    q = samples(configurations, mechanism.model.nq, "configurations")
    dof = len(mechanism.independent)
    rates = samples(velocities, dof, "independent velocities", len(q))
    second = samples(accelerations, dof, "accelerations", len(q))
    partition = Partition(mechanism)
    if mechanism.rows == 0 == len(partition.dependent):
        v, a = np.empty_like(rates), np.empty_like(second)
        v[:, partition.chosen], a[:, partition.chosen] = rates, second
        return _tree_rows(mechanism, q, v, a, partition.chosen)
    places = _places(mechanism)

    def columns(block: BlockProjection, rows: slice) -> tuple[FloatArray, ...]:
        motion = block.moving(rates[rows].T)
        a = motion.gamma + np.einsum("ijn,nj->in", block.G, second[rows])
        found = moving_columns(block.pose.tree, places, block.G, motion.tree, a)
        return (_tied(mechanism, found),)

    width = _width(mechanism, "full")
    return in_projected_blocks(mechanism, q, partition, columns, width)[0]


def resting_regressor(
    mechanism: Mechanism, configurations: FloatArray, G: FloatArray
) -> FloatArray:
    """As ``gravity_regressor``, with the projection G (N, nv, dof) known."""
    places, q = _places(mechanism), np.atleast_2d(configurations)

    def columns(rows: slice) -> tuple[FloatArray, ...]:
        pose = tree_pose(mechanism, q[rows])
        return (_tied(mechanism, resting_columns(pose, places, np.moveaxis(G[rows], 0, 2))),)

    return in_blocks(len(G), columns, _width(mechanism, "gravity"))[0]


def moving_regressor(mechanism: Mechanism, motion: ClosedMotion) -> FloatArray:
    """As ``dynamic_regressor``, with the motion of all coordinates known."""
    places, G = _places(mechanism), motion.projection.G
    if mechanism.rows == 0:
        state = motion.configurations, motion.velocities, motion.accelerations
        return _tree_rows(mechanism, *state, motion.projection.independent)

    def columns(rows: slice) -> tuple[FloatArray, ...]:
        pose = tree_pose(mechanism, motion.configurations[rows])
        moving = tree_motion(pose, motion.velocities[rows].T)
        a = motion.accelerations[rows].T
        found = moving_columns(pose, places, np.moveaxis(G[rows], 0, 2), moving, a)
        return (_tied(mechanism, found),)

    return in_blocks(len(G), columns, _width(mechanism, "full"))[0]


def _tree_rows(
    mechanism: Mechanism, q: FloatArray, v: FloatArray, a: FloatArray, chosen: IntArray
) -> FloatArray:
    """Where nothing is projected, Pinocchio's own recursion is the shortest way."""
    Y = tree_regressor(mechanism, q, v, a)
    return Y if np.array_equal(chosen, np.arange(Y.shape[1])) else Y[:, chosen]


def _width(mechanism: Mechanism, model: str) -> int:
    """Numbers per sample in the regressor of all bodies."""
    return len(mechanism.columns(model)) * len(mechanism.independent)


def _places(mechanism: Mechanism) -> IntArray:
    """Where the joints that carry the bodies are in the joint layout."""
    ids = joint_layout(mechanism).joint_ids.tolist()
    return np.array([ids.index(body.joint_id) for body in mechanism.bodies], dtype=np.int64)


def _tied(mechanism: Mechanism, columns: FloatArray) -> FloatArray:
    """Columns (dof, n, N) from those of the bodies, with those of tied links added up."""
    if mechanism.ties:
        places = tie_indices(mechanism.links, mechanism.ties)
        sums = np.zeros((int(places.max()) + 1, *columns.shape[1:]))
        for place, own in zip(places, columns, strict=True):
            sums[place] += own
        columns = sums
    bodies, kinds, dof, count = columns.shape
    return np.moveaxis(columns.reshape(bodies * kinds, dof, count), 0, 1)
