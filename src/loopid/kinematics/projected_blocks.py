"""The motion that the loops allow, block by block of samples; arrays hold samples last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import MobilityError
from loopid.kinematics.blocks import in_blocks
from loopid.kinematics.dependent import DependentColumns, elimination_for
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.loops import LoopPose, loop_pose
from loopid.kinematics.refusals import NEAR_SINGULARITY, refuse_dependent, refuse_singular
from loopid.kinematics.scaling import coordinate_scales, row_scales, scaled_by_samples
from loopid.kinematics.tree import TreeMotion, tree_motion
from loopid.robot import Mechanism


class Partition:
    """Velocity indices of the independent coordinates and of all others."""

    def __init__(self, mechanism: Mechanism, names: Sequence[str] | None = None) -> None:
        names = mechanism.independent if names is None else names
        self.chosen = mechanism.velocity_indices(names)
        if len(set(self.chosen)) != len(self.chosen):
            raise MobilityError(f"a joint is named twice among {', '.join(names)}")
        self.dependent = np.setdiff1d(np.arange(mechanism.model.nv), self.chosen)


@dataclass(frozen=True)
class BlockMotion:
    """A motion that the loops allow.

    Attributes
    ----------
    velocities, gamma : FloatArray
        (nv, N), of all coordinates, and their accelerations without independent ones.
    tree : TreeMotion
    """

    velocities: FloatArray
    gamma: FloatArray
    tree: TreeMotion


@dataclass(frozen=True)
class BlockProjection:
    """Some samples.

    Attributes
    ----------
    mechanism : Mechanism
    pose : LoopPose
    jacobian : FloatArray
        (rows, nv, N), in common units.
    partition : Partition
    columns : DependentColumns
        Those of the Jacobian.
    """

    mechanism: Mechanism
    pose: LoopPose
    jacobian: FloatArray
    partition: Partition
    columns: DependentColumns

    @classmethod
    def at(cls, mechanism: Mechanism, q: FloatArray, partition: Partition) -> BlockProjection:
        """Project at closed configurations (N, nq)."""
        pose = loop_pose(mechanism, q)
        scaled = scaled_by_samples(mechanism, pose.jacobian())
        elimination = elimination_for(mechanism, partition.dependent)
        dependent = scaled[:, partition.dependent]
        columns = DependentColumns.of(dependent, elimination, NEAR_SINGULARITY)
        return cls(mechanism, pose, scaled, partition, columns)

    @cached_property
    def G(self) -> FloatArray:  # noqa: N802
        """(nv, dof, N), all velocities from the independent ones."""
        scales = coordinate_scales(self.mechanism)
        chosen, dependent = self.partition.chosen, self.partition.dependent
        G = np.zeros((len(scales), len(chosen), self.jacobian.shape[2]))
        G[chosen, np.arange(len(chosen))] = 1.0
        steps = self.columns.solve(self.jacobian[:, chosen])
        G[dependent] = steps * -(scales[dependent, None] / scales[chosen])[:, :, None]
        return G

    def moving(self, rates: FloatArray) -> BlockMotion:
        """The motion at independent velocities (dof, N)."""
        velocities = np.einsum("ijn,jn->in", self.G, rates)
        tree = tree_motion(self.pose.tree, velocities)
        drift = row_scales(self.mechanism)[:, None] * self.pose.drift(tree)
        dependent = self.partition.dependent
        gamma = np.zeros_like(velocities)
        steps = self.columns.solve(drift[:, None])[:, 0]
        gamma[dependent] = steps * -coordinate_scales(self.mechanism)[dependent, None]
        return BlockMotion(velocities, gamma, tree)


def in_projected_blocks(
    mechanism: Mechanism,
    q: FloatArray,
    partition: Partition,
    values: Callable[[BlockProjection, slice], tuple[FloatArray, ...]],
    width: int = 1,
) -> tuple[FloatArray, ...]:
    """Arrays (N, ...) from those that each block gives (..., samples of the block).

    Refuses singular configurations and warns of nearly singular ones, as ``project`` says. The
    width is that of ``in_blocks``.
    """
    doubts: list[tuple[IntArray, Factorisation]] = []
    jacobians: list[FloatArray] = []  # of the first sample of each block

    def block_values(rows: slice) -> tuple[FloatArray, ...]:
        block = BlockProjection.at(mechanism, q[rows], partition)
        doubts.append((rows.start + block.columns.doubtful, block.columns.factors))
        jacobians.append(block.jacobian[:, :, :1])
        return values(block, rows)

    arrays = in_blocks(len(q), block_values, width)
    refuse_singular(doubts, len(partition.dependent))
    refuse_dependent(jacobians[0], len(partition.chosen))
    return arrays
