"""Motion of the whole mechanism from that of its independent joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, samples
from loopid.kinematics.projected_blocks import BlockProjection, Partition, in_projected_blocks
from loopid.kinematics.projection import Projection
from loopid.robot import Mechanism


@dataclass(frozen=True)
class ClosedMotion:
    """Velocities and accelerations that keep the loops closed, at N samples.

    Attributes
    ----------
    configurations : FloatArray
        (N, nq), closed.
    velocities, accelerations : FloatArray
        (N, nv), v = G u̇ and a = G ü + γ.
    gamma : FloatArray
        (N, nv), the part of the accelerations that the velocities cause.
    projection : Projection
    """

    configurations: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    gamma: FloatArray
    projection: Projection

    def projected(self, tree_columns: FloatArray) -> FloatArray:
        """Columns of the actuated forces (N, dof, n) from those of the tree's (N, nv, n)."""
        return np.asarray(self.projection.G.transpose(0, 2, 1) @ tree_columns, dtype=np.float64)


@checked
def closed_motion(
    mechanism: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    accelerations: FloatArray,
    independent: Sequence[str] | None = None,
) -> ClosedMotion:
    """Complete the motion of the independent joints, by default the actuated ones.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    velocities, accelerations : FloatArray
        (N, dof) of the independent joints.
    independent : sequence of str, optional
        Their names.
    """
    q = samples(configurations, mechanism.model.nq, "configurations")
    parts = Partition(mechanism, independent)
    dof = len(parts.chosen)
    rates = samples(velocities, dof, "independent velocities", len(q))
    second = samples(accelerations, dof, "accelerations", len(q))

    def values(block: BlockProjection, rows: slice) -> tuple[FloatArray, ...]:
        motion = block.moving(rates[rows].T)
        a = np.einsum("ijn,nj->in", block.G, second[rows]) + motion.gamma
        return block.columns.matrices, block.G, motion.gamma, motion.velocities, a

    columns, G, gamma, v, a = in_projected_blocks(mechanism, q, parts, values)
    return ClosedMotion(q, v, a, gamma, Projection(G, gamma, parts.chosen, columns))
