"""Velocities and accelerations of all coordinates from those of the independent ones.

v = G u̇ and a = G ü + γ, with G = [I; -A_d⁺ A_u] and A γ = -Ȧ v [Featherstone2008, ch. 8].
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray, samples
from loopid.errors import MobilityError, SingularityError, SingularityWarning
from loopid.kinematics.constraint import constraint_drift, constraint_jacobian
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.scaling import coordinate_scales, row_scales, scaled_jacobian
from loopid.mechanism import Mechanism

# Below this singularity measure forces in the loops exceed the motors' some thousandfold.
NEAR_SINGULARITY = 1e-3


@dataclass(frozen=True)
class Projection:
    """The motion that the loops allow, at N configurations.

    Attributes
    ----------
    G : FloatArray
        (N, nv, dof), all velocities from the independent ones.
    gamma : FloatArray or None
        (N, nv), accelerations at zero independent acceleration; None without velocities.
    singularity : FloatArray
        (N,), smallest over largest singular value of the dependent columns of the constraint
        Jacobian in common units: 0 where the motors lose control of the motion (type II).
    independent : IntArray
        (dof,), velocity indices of the independent coordinates.
    """

    G: FloatArray
    gamma: FloatArray | None
    singularity: FloatArray
    independent: IntArray


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
    chosen, dependent = partition(mechanism, independent)
    q = samples(configurations, mechanism.model.nq, "configurations")
    jacobian = scaled_jacobian(mechanism, constraint_jacobian(mechanism, q))
    factors = Factorisation.of(jacobian[:, :, dependent])
    measure = _measure(factors, len(dependent))
    _refuse_singular(factors, measure, len(dependent))
    _refuse_dependent(jacobian, len(chosen))
    G = velocity_map(mechanism, factors, jacobian, chosen, dependent)
    gamma = None
    if independent_velocities is not None:
        rates = samples(independent_velocities, len(chosen), "independent velocities", len(q))
        velocities = np.einsum("nij,nj->ni", G, rates)
        gamma = _gamma(mechanism, q, velocities, factors, dependent)
    return Projection(G, gamma, measure, chosen)


def singularity_measure(
    mechanism: Mechanism, configurations: FloatArray, independent: Sequence[str] | None = None
) -> FloatArray:
    """The measure (N,) of ``Projection.singularity``, without refusing singular configurations."""
    _, dependent = partition(mechanism, independent)
    jacobian = scaled_jacobian(mechanism, constraint_jacobian(mechanism, configurations))
    return _measure(Factorisation.of(jacobian[:, :, dependent]), len(dependent))


def partition(
    mechanism: Mechanism, independent: Sequence[str] | None = None
) -> tuple[IntArray, IntArray]:
    """Velocity indices of the independent coordinates, the mechanism's by default, and the rest."""
    names = mechanism.independent if independent is None else independent
    chosen = mechanism.velocity_indices(names)
    if len(set(chosen)) != len(chosen):
        raise MobilityError(f"a joint is named twice among {', '.join(independent or ())}")
    rest = np.setdiff1d(np.arange(mechanism.model.nv), chosen)
    return chosen, rest


def _measure(factors: Factorisation, width: int) -> FloatArray:
    count, values = factors.values.shape
    if width == 0:
        return np.ones(count)
    if values < width:
        return np.zeros(count)
    largest = np.maximum(factors.values[:, 0], np.finfo(float).tiny)
    return np.asarray(factors.values[:, width - 1] / largest, dtype=np.float64)


def _refuse_singular(factors: Factorisation, measure: FloatArray, width: int) -> None:
    lost = np.flatnonzero(factors.rank < width)
    if len(lost):
        raise SingularityError(
            f"sample {lost[0]} is singular: the independent joints determine "
            f"{factors.rank[lost[0]]} of {width} dependent coordinates "
            f"(singularity measure {measure[lost[0]]:.1e}; {len(lost)} such samples)"
        )
    near = np.flatnonzero(measure < NEAR_SINGULARITY)
    if len(near):
        warnings.warn(
            f"{len(near)} samples are near a singularity, first sample {near[0]} "
            f"(measure {measure[near[0]]:.1e}, warned of below {NEAR_SINGULARITY:g})",
            SingularityWarning,
            stacklevel=3,
        )


def _refuse_dependent(jacobian: FloatArray, count: int) -> None:
    """Refuse more independent joints than the first sample has degrees of freedom."""
    freedom = jacobian.shape[2] - int(Factorisation.of(jacobian[:1]).rank.max(initial=0))
    if count > freedom:
        raise MobilityError(
            f"{count} independent joints are too many for {freedom} degrees of freedom"
        )


def velocity_map(
    mechanism: Mechanism,
    factors: Factorisation,
    jacobian: FloatArray,
    chosen: IntArray,
    dependent: IntArray,
) -> FloatArray:
    """G (N, nv, dof) from the factors of the dependent columns of scaled Jacobians."""
    scales = coordinate_scales(mechanism)
    G = np.zeros((len(jacobian), mechanism.model.nv, len(chosen)))
    G[:, chosen, np.arange(len(chosen))] = 1.0
    steps = -factors.solve(jacobian[:, :, chosen])
    G[:, dependent] = scales[dependent, None] * steps / scales[chosen]
    return G


def _gamma(
    mechanism: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    factors: Factorisation,
    dependent: IntArray,
) -> FloatArray:
    drift = row_scales(mechanism) * constraint_drift(mechanism, configurations, velocities)
    gamma = np.zeros_like(velocities)
    steps = -factors.solve(drift[:, :, None])[:, :, 0]
    gamma[:, dependent] = coordinate_scales(mechanism)[dependent] * steps
    return gamma
