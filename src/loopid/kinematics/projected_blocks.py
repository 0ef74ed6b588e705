"""The motion that the loops allow, block by block of samples; arrays hold samples last."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import MobilityError, SingularityError, SingularityWarning
from loopid.kinematics.blocks import in_blocks
from loopid.kinematics.dependent import DependentColumns, elimination_for
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.loops import LoopPose, loop_pose
from loopid.kinematics.scaling import (
    coordinate_scales,
    row_scales,
    scaled_by_samples,
)
from loopid.kinematics.tree import TreeMotion, tree_motion
from loopid.mechanism import Mechanism

# Below this singularity measure forces in the loops exceed the motors' some thousandfold.
NEAR_SINGULARITY = 1e-3


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
        scales = coordinate_scales(self.mechanism)[:, None, None]
        chosen, dependent = self.partition.chosen, self.partition.dependent
        G = np.zeros((len(scales), len(chosen), self.jacobian.shape[2]))
        G[chosen, np.arange(len(chosen))] = 1.0
        steps = self.columns.solve(self.jacobian[:, chosen])
        G[dependent] = steps * -scales[dependent] / scales[chosen, 0]
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
    _refuse_singular(doubts, len(partition.dependent))
    _refuse_dependent(jacobians[0], len(partition.chosen))
    return arrays


def measure_of(factors: Factorisation, width: int) -> FloatArray:
    """Singularity measure (N,) of dependent columns of a width, see ``Projection``."""
    count, values = factors.values.shape
    if width == 0:
        return np.ones(count)
    if values < width:
        return np.zeros(count)
    largest = np.maximum(factors.values[:, 0], np.finfo(float).tiny)
    return np.asarray(factors.values[:, width - 1] / largest, dtype=np.float64)


def _refuse_singular(doubts: list[tuple[IntArray, Factorisation]], width: int) -> None:
    """Refuse singular samples and warn of nearly singular ones, among those in doubt."""
    k = np.concatenate([doubtful for doubtful, _ in doubts])
    rank = np.concatenate([factors.rank for _, factors in doubts])
    measure = np.concatenate([measure_of(factors, width) for _, factors in doubts])
    lost = np.flatnonzero(rank < width)
    if len(lost):
        raise SingularityError(
            f"sample {k[lost[0]]} is singular: the independent joints determine "
            f"{rank[lost[0]]} of {width} dependent coordinates "
            f"(singularity measure {measure[lost[0]]:.1e}; {len(lost)} such samples)"
        )
    near = np.flatnonzero(measure < NEAR_SINGULARITY)
    if len(near):
        warnings.warn(
            f"{len(near)} samples are near a singularity, first sample {k[near[0]]} "
            f"(measure {measure[near[0]]:.1e}, warned of below {NEAR_SINGULARITY:g})",
            SingularityWarning,
            stacklevel=4,
        )


def _refuse_dependent(jacobian: FloatArray, count: int) -> None:
    """Refuse more independent joints than the first sample has degrees of freedom."""
    rank = Factorisation.of(np.moveaxis(jacobian, 2, 0)).rank.max(initial=0)
    freedom = jacobian.shape[1] - int(rank)
    if count > freedom:
        raise MobilityError(
            f"{count} independent joints are too many for {freedom} degrees of freedom"
        )
