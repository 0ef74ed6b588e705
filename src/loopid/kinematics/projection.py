"""Velocities and accelerations of all coordinates from those of the independent ones.

v = G u̇ and a = G ü + γ, with G = [I; -A_d⁺ A_u] and A γ = -Ȧ v [Featherstone2008, ch. 8].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray, samples
from loopid.kinematics.constraint import constraint_jacobian
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.projected_blocks import BlockProjection, Partition, in_projected_blocks
from loopid.kinematics.refusals import NEAR_SINGULARITY, measure_of
from loopid.kinematics.scaling import scaled_jacobian
from loopid.robot import Mechanism

__all__ = [
    "NEAR_SINGULARITY",
    "Projection",
    "partition",
    "project",
    "singularity_measure",
]


@dataclass(frozen=True)
class Projection:
    """The motion that the loops allow, at N configurations.

    Attributes
    ----------
    G : FloatArray
        (N, nv, dof), all velocities from the independent ones.
    gamma : FloatArray or None
        (N, nv), accelerations at zero independent acceleration; None without velocities.
    independent : IntArray
        (dof,), velocity indices of the independent coordinates.
    dependent_columns : FloatArray
        (N, rows, nv - dof), columns of the constraint Jacobian in common units.
    """

    G: FloatArray
    gamma: FloatArray | None
    independent: IntArray
    dependent_columns: FloatArray

    @cached_property
    def singularity(self) -> FloatArray:
        """Smallest over largest singular value (N,) of ``dependent_columns``.

        0 where the motors lose control of the motion (type II).
        """
        return measure_of(Factorisation.of(self.dependent_columns), self.dependent_columns.shape[2])


@checked
def project(
    mechanism: Mechanism,
    configurations: FloatArray,
    independent_velocities: FloatArray | None = None,
    independent: Sequence[str] | None = None,
) -> Projection:
    """Project the motion onto independent joints, by default the actuated ones.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    independent_velocities : FloatArray, optional
        (N, dof), needed for ``gamma``.
    independent : sequence of str, optional
        Names of the independent joints.

    Raises
    ------
    MobilityError
        When the independent joints are more than the degrees of freedom.
    SingularityError
        Where the independent joints do not determine the motion.

    Warns
    -----
    SingularityWarning
        Where they hardly do: the measure is below ``NEAR_SINGULARITY``.
    """
    q = samples(configurations, mechanism.model.nq, "configurations")
    parts = Partition(mechanism, independent)
    rates = None
    if independent_velocities is not None:
        rates = samples(independent_velocities, len(parts.chosen), "independent velocities", len(q))

    def values(block: BlockProjection, rows: slice) -> tuple[FloatArray, ...]:
        gamma = () if rates is None else (block.moving(rates[rows].T).gamma,)
        return block.columns.matrices, block.G, *gamma

    columns, G, *gamma = in_projected_blocks(mechanism, q, parts, values)
    return Projection(G, gamma[0] if gamma else None, parts.chosen, columns)


@checked
def singularity_measure(
    mechanism: Mechanism, configurations: FloatArray, independent: Sequence[str] | None = None
) -> FloatArray:
    """The measure (N,) of ``Projection.singularity``, without refusing singular configurations."""
    _, dependent = partition(mechanism, independent)
    jacobian = scaled_jacobian(mechanism, constraint_jacobian(mechanism, configurations))
    return measure_of(Factorisation.of(jacobian[:, :, dependent]), len(dependent))


def partition(
    mechanism: Mechanism, independent: Sequence[str] | None = None
) -> tuple[IntArray, IntArray]:
    """Velocity indices of the independent coordinates, the mechanism's by default, and the rest."""
    parts = Partition(mechanism, independent)
    return parts.chosen, parts.dependent
