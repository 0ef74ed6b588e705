"""The motion that the loops allow: all velocities and accelerations from the independent ones.

v = G u̇ and a = G ü + γ, with G = [I; -A_d⁺ A_u] and A γ = -Ȧ v [Featherstone2008, ch. 8]: u are
the independent coordinates, A_u and A_d the columns of the closure Jacobian at them and at all
others. ``velocity_map`` is the place where G is computed, for one sample and for many.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked, samples
from loopid.errors import AccuracyWarning, MobilityError, SingularityError, warn
from loopid.kinematics.constraint import Constraint, constraint_jacobian, scaled_jacobian
from loopid.kinematics.linear import Factorisation, Solver, least_over_largest
from loopid.kinematics.poses import blocks, prepared
from loopid.records import record
from loopid.robot.mechanism import RANK_TOLERANCE, Mechanism

# Below this singularity measure forces in the loops exceed the motors' some thousandfold.
NEAR_SINGULARITY = 1e-3


@record
class Projection:
    """The motion that the loops allow, at N configurations."""

    G: FloatArray  # (N, nv, dof), all velocities from the independent ones
    independent: IntArray  # (dof,), velocity indices of the independent coordinates
    # (N, rows, nv - dof), columns of the constraint Jacobian in common units
    dependent_columns: FloatArray
    # Singular values of these columns below this fraction of the largest counted as zero
    tolerance: float = RANK_TOLERANCE

    @cached_property
    def singularity(self) -> FloatArray:
        """Smallest over largest singular value (N,) of ``dependent_columns``.

        0 where the motors lose control of the motion (type II).
        """
        return least_over_largest(self.dependent_columns)


@record
class ClosedMotion:
    """Velocities and accelerations that keep the loops closed, at N samples."""

    configurations: FloatArray  # (N, nq), closed
    velocities: FloatArray  # (N, nv), v = G u̇ and a = G ü + γ
    accelerations: FloatArray
    gamma: FloatArray  # (N, nv), the part of the accelerations that the velocities cause
    projection: Projection

    def projected(self, tree_columns: FloatArray) -> FloatArray:
        """Columns of the actuated forces (N, dof, n) from those of the tree's (N, nv, n)."""
        return np.asarray(self.projection.G.transpose(0, 2, 1) @ tree_columns, dtype=np.float64)


@checked
def project(
    mechanism: Mechanism,
    configurations: FloatArray,
    independent: Sequence[str] | None = None,
) -> Projection:
    """Project the motion onto independent joints, by default the actuated ones.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
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
    AccuracyWarning
        Where they hardly do: the measure is below ``NEAR_SINGULARITY``.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> loopid.kinematics.project(robot, robot.reference).G.shape
    (1, 13, 4)
    """
    q = samples(configurations, mechanism.model.nq, "configurations")
    parts = partition(mechanism, independent)
    return _projection(_parts(mechanism, q, parts, None), parts)


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

    Raises
    ------
    MobilityError, SingularityError
        As ``project``.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> rates, still = [[0.1, 0, 0, 0]], [[0, 0, 0, 0]]
    >>> motion = loopid.kinematics.closed_motion(robot, robot.reference, rates, still)
    >>> motion.velocities.shape
    (1, 13)
    """
    q = samples(configurations, mechanism.model.nq, "configurations")
    parts = partition(mechanism, independent)
    rates = samples(velocities, len(parts[0]), "independent velocities", len(q))
    second = samples(accelerations, len(parts[0]), "accelerations", len(q))
    return completed(mechanism, q, parts, rates, second)


@checked
def singularity_measure(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """The measure (N,) of ``Projection.singularity``, without refusing singular configurations."""
    _, dependent = partition(mechanism)
    jacobian = scaled_jacobian(mechanism, constraint_jacobian(mechanism, configurations))
    return least_over_largest(jacobian[:, :, dependent])


def partition(
    mechanism: Mechanism, independent: Sequence[str] | None = None
) -> tuple[IntArray, IntArray]:
    """Velocity indices of the independent coordinates, the mechanism's by default, and the rest."""
    known = prepared(mechanism).partitions
    key = None if independent is None else tuple(independent)
    if key not in known:
        names = mechanism.independent if key is None else key
        chosen = mechanism.velocity_indices(names)
        if len(set(chosen)) != len(chosen):
            raise MobilityError(
                f"a joint is named twice among {', '.join(names)}", given=tuple(names)
            )
        dependent = np.setdiff1d(np.arange(mechanism.model.nv), chosen)
        chosen.setflags(write=False)
        dependent.setflags(write=False)
        known[key] = chosen, dependent
    return known[key]


def velocity_maps(
    mechanism: Mechanism, q: FloatArray, parts: tuple[IntArray, IntArray]
) -> FloatArray:
    """G (N, nv, dof) of ``project`` alone."""
    return _joined([part.G for part in _parts(mechanism, q, parts, None)])


def completed(
    mechanism: Mechanism,
    q: FloatArray,
    parts: tuple[IntArray, IntArray],
    rates: FloatArray,
    accelerations: FloatArray,
) -> ClosedMotion:
    """As ``closed_motion``, of arrays and indices that are checked."""
    found = _parts(mechanism, q, parts, rates)
    projection = _projection(found, parts)
    v, gamma = _joined([part.v for part in found]), _joined([part.gamma for part in found])
    a = (projection.G @ accelerations[:, :, None])[:, :, 0] + gamma
    a.setflags(write=False)  # a record need not copy what nobody else has
    return ClosedMotion(q, v, a, gamma, projection)


class _Part(NamedTuple):
    """Some samples."""

    G: FloatArray
    solver: Solver  # with the dependent columns A_d
    v: FloatArray  # (N, nv), and γ; empty where no rates were given
    gamma: FloatArray


NOTHING = np.empty((0, 0))


def _parts(
    mechanism: Mechanism,
    q: FloatArray,
    parts: tuple[IntArray, IntArray],
    rates: FloatArray | None,
) -> list[_Part]:
    """All samples, block by block, none of which may be singular."""
    found, doubts = list[_Part](), list[_Doubt]()
    for rows in blocks(len(q)):
        constraint = Constraint(mechanism, q[rows])
        A = scaled_jacobian(mechanism, constraint.jacobian())
        # No more equations than dependent coordinates have no larger rank.
        if rows.start == 0 and A.shape[1] > len(parts[1]):
            _refuse_too_many(mechanism, A[:1], len(parts[0]))
        G, solver = velocity_map(mechanism, A, *parts)
        if len(solver.ill_conditioned):
            doubts.append((rows.start + solver.ill_conditioned, solver.factors))
        v = gamma = NOTHING
        if rates is not None:
            v = (G @ rates[rows, :, None])[:, :, 0]
            gamma = drift_acceleration(constraint, v, parts[1], solver)
        found.append(_Part(G, solver, v, gamma))
    if doubts:
        _refuse_singular(doubts, len(parts[1]))
    return found


def _projection(found: list[_Part], parts: tuple[IntArray, IntArray]) -> Projection:
    columns = _joined([part.solver.matrices for part in found])
    return Projection(_joined([part.G for part in found]), parts[0], columns)


def _joined(arrays: list[FloatArray]) -> FloatArray:
    """One read-only array, which nobody else has: a record need not copy it."""
    whole = arrays[0] if len(arrays) == 1 else np.concatenate(arrays)
    whole.setflags(write=False)
    return whole


def velocity_map(
    mechanism: Mechanism, jacobian: FloatArray, chosen: IntArray, dependent: IntArray
) -> tuple[FloatArray, Solver]:
    """G (N, nv, dof) = [I; -A_d⁺ A_u] of Jacobians in common units, and the solver with A_d."""
    scales = mechanism.coordinate_scales
    solver = Solver.of(jacobian.take(dependent, axis=2), NEAR_SINGULARITY)
    dependent_rows = solver.solve(jacobian.take(chosen, axis=2))
    dependent_rows *= scales.take(dependent)[:, None] / -scales.take(chosen)
    G = np.empty((len(jacobian), len(scales), len(chosen)))
    G[:, chosen], G[:, dependent] = np.eye(len(chosen)), dependent_rows
    return G, solver


def drift_acceleration(
    constraint: Constraint, v: FloatArray, dependent: IntArray, solver: Solver
) -> FloatArray:
    """γ (N, nv) at velocities (N, nv), with the solver of A_d: A γ = -Ȧ v."""
    mechanism, gamma = constraint.mechanism, np.zeros_like(v)
    drift = mechanism.row_scales * constraint.drift(v)
    step = solver.solve(drift[:, :, None])[:, :, 0]
    gamma[:, dependent] = -mechanism.coordinate_scales[dependent] * step
    return gamma


# Numbers of samples whose condition is in doubt, and their singular values.
_Doubt = tuple[IntArray, Factorisation]


def _refuse_singular(doubts: list[_Doubt], width: int) -> None:
    """Refuse singular samples and warn of nearly singular ones, among those in doubt."""
    k = np.concatenate([ill_conditioned for ill_conditioned, _ in doubts])
    rank = np.concatenate([factors.rank for _, factors in doubts])
    measure = np.concatenate([factors.least_over_largest for _, factors in doubts])
    lost = np.flatnonzero(rank < width)
    if len(lost):
        first = int(lost[0])
        raise SingularityError(
            f"sample {k[first]} is singular: the independent joints determine {rank[first]} of "
            f"{width} dependent coordinates (singularity measure {measure[first]:.1e}; "
            f"{len(lost)} such samples)",
            sample=int(k[first]),
            rank=int(rank[first]),
            dependent=width,
            measure=float(measure[first]),
            samples=len(lost),
            tolerance=doubts[0][1].tolerance,
        )
    near = np.flatnonzero(measure < NEAR_SINGULARITY)
    if len(near):
        warn(
            f"{len(near)} samples are near a singularity, first sample {k[near[0]]} "
            f"(measure {measure[near[0]]:.1e}, warned of below {NEAR_SINGULARITY:g})",
            AccuracyWarning,
        )


def _refuse_too_many(mechanism: Mechanism, jacobian: FloatArray, count: int) -> None:
    """Refuse more independent joints than the first sample has degrees of freedom."""
    rank = Factorisation.of(jacobian, mechanism.closure_rank_tolerance).rank
    freedom = mechanism.model.nv - int(rank.max(initial=0))
    if count > freedom:
        hint = ""
        if count == len(mechanism.independent):  # as many as at the reference
            hint = ", which has more at its reference: that is singular, so give another one"
        raise MobilityError(
            f"{count} independent joints are too many for {freedom} degrees of freedom of "
            f"{mechanism.name}{hint}",
            given=count,
            freedom=freedom,
        )
