"""The motion that the loops allow: all velocities and accelerations from the independent ones.

v = G u̇ and a = G ü + γ, with G = [I; -A_d⁺ A_u] and A γ = -Ȧ v [Featherstone2008, ch. 8]. Here u
are the independent coordinates. A_u and A_d are the columns of the closure Jacobian at them and at
all others. ``velocity_map`` is the place where G is computed, for one sample and for many. The
solves with ranks that it and others need come first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetri

from loopid.arguments import FloatArray, IntArray, checked, samples
from loopid.errors import AccuracyWarning, DataError, MobilityError, SingularityError, counted, warn
from loopid.kinematics.constraint import Constraint, constraint_jacobian, scaled_jacobian
from loopid.kinematics.poses import blocks, prepared
from loopid.records import derived, read_only, record
from loopid.robot.robot import RANK_TOLERANCE, Robot

# Below this singularity measure forces in the loops exceed the motors' some thousandfold.
NEAR_SINGULARITY = 1e-3
# Part of the robot's length by which loops may be open: a configuration with four digits is closed.
OPEN = 1e-4
# The same of configurations of simulators whose constraints give way, which can be closed.
SOFT = 1e-2
CLOSES = "loopid.kinematics.closed_configurations(robot, q) closes it where its motors are"
OTHERWISE = (
    "loopid.Dynamics(robot).pose(u).q is closed, for positions u of the independent coordinates"
)


@record
class Factorisation:
    """Singular value decompositions of N matrices (N, m, n), for repeated solves."""

    left: FloatArray  # (N, m, k)
    values: FloatArray  # (N, k), singular values, descending
    right: FloatArray  # (N, k, n)
    rank: IntArray  # (N,)
    least: FloatArray  # (N,), the values up to which they count as zero
    tolerance: float = RANK_TOLERANCE  # these relative to the largest value

    @classmethod
    def of(cls, matrices: FloatArray, tolerance: float = RANK_TOLERANCE) -> Factorisation:
        """Factor a stack of matrices."""
        left, values, right = np.linalg.svd(matrices, full_matrices=False)
        least = tolerance * values[:, :1].max(axis=1, initial=0.0)
        rank = (values > least[:, None]).sum(axis=1)
        return cls(left, values, right, rank, least, tolerance)

    @property
    def least_over_largest(self) -> FloatArray:
        """Ratio (N,) of the n-th singular value to the first; 1 without columns."""
        return ratio_to_largest(self.values, self.right.shape[2])

    def solve(self, right_hand_sides: FloatArray, damping: FloatArray | None = None) -> FloatArray:
        """Minimum-norm least-squares solutions (N, n, c) of stacked systems with (N, m, c).

        With a damping (N,) the steps of Levenberg and Marquardt, (AᵀA + d² I)⁻¹ Aᵀ b.
        """
        values = np.where(self.values > self.least[:, None], self.values, np.inf)
        inverse = 1.0 / values
        if damping is not None:
            inverse = 1.0 / (values + damping[:, None] ** 2 / values)
        projected = self.left.swapaxes(1, 2) @ right_hand_sides
        return np.asarray(self.right.swapaxes(1, 2) @ (inverse[:, :, None] * projected))


def ratio_to_largest(values: FloatArray, rank: int) -> FloatArray:
    """Ratio (N,) of a singular value to the first of values (N, k); 1 of rank 0, 0 of none."""
    count, found = values.shape
    if not 0 < rank <= found:
        return np.full(count, float(rank == 0))
    largest = np.maximum(values[:, 0], np.finfo(float).tiny)
    return np.asarray(values[:, rank - 1] / largest, dtype=np.float64)


@dataclass(eq=False)
class Solver:
    """Least-squares solves with N matrices (N, m, n): inverses where these are proven regular.

    Of more rows than columns, as of planar loops, the inverse is the pseudoinverse R⁻¹Qᵀ. It takes
    a fifth of the time of a singular value decomposition. The Frobenius norms of a matrix and its
    inverse bound its condition. Where the bound proves nothing, singular values decide.
    """

    matrices: FloatArray  # (N, m, n)
    inverses: FloatArray | None  # (N, n, m); None where m < n, or one is exactly singular
    ill_conditioned: IntArray  # samples whose ratio of singular values is not proven to be larger

    @classmethod
    def of(cls, matrices: FloatArray, bound: float) -> Solver:
        """Invert what is proven to have a ratio of singular values above the bound."""
        count, rows, columns = matrices.shape
        if columns == 0:
            return cls(matrices, None, np.empty(0, dtype=np.int64))
        inverses = _inverses(matrices) if rows >= columns else None
        if inverses is None:
            return cls(matrices, None, np.arange(count))
        square_norms = _square_norms(matrices) * _square_norms(inverses)
        # Written so that a NaN counts as not proven.
        unproven = ~(square_norms < 1.0 / (1.001 * bound) ** 2)
        return cls(matrices, inverses, unproven.nonzero()[0])

    @cached_property
    def factors(self) -> Factorisation:
        """Singular value decompositions at the ill-conditioned samples."""
        return Factorisation.of(self.matrices[self.ill_conditioned])

    def solve(self, right_hand_sides: FloatArray) -> FloatArray:
        """Minimum-norm least-squares solutions (N, n, c) of stacked systems with (N, m, c)."""
        if self.inverses is None:
            if not len(self.ill_conditioned):
                return np.empty((len(self.matrices), 0, right_hand_sides.shape[2]))
            return self.factors.solve(right_hand_sides)
        solutions: FloatArray = self.inverses @ right_hand_sides
        if len(self.ill_conditioned):
            doubtful = right_hand_sides[self.ill_conditioned]
            solutions[self.ill_conditioned] = self.factors.solve(doubtful)
        return solutions


def _inverses(matrices: FloatArray) -> FloatArray | None:
    """Inverses, or pseudoinverses of m > n rows; None where one is exactly singular."""
    if matrices.shape[1] > matrices.shape[2]:
        Q, R = np.linalg.qr(matrices)
        inverses = _inverses(R)
        return None if inverses is None else np.asarray(inverses @ Q.swapaxes(1, 2))
    if len(matrices) == 1:  # LAPACK itself, in a third of the time
        factors, pivots, singular = dgetrf(matrices[0])
        return None if singular else dgetri(factors, pivots)[0][None]
    try:
        return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None


def _square_norms(matrices: FloatArray) -> FloatArray:
    flat = matrices.reshape(len(matrices), matrices.shape[1] * matrices.shape[2])
    return np.asarray(np.vecdot(flat, flat), dtype=np.float64)


def null_space(matrix: FloatArray, tolerance: float = RANK_TOLERANCE) -> FloatArray:
    """Orthonormal basis (n, d) of the null space of one matrix (m, n)."""
    _, values, right = np.linalg.svd(matrix)
    return np.asarray(right[int((values > tolerance * values.max(initial=0.0)).sum()) :].T)


def least_over_largest(matrices: FloatArray) -> FloatArray:
    """Ratio (N,) of the n-th singular value to the first of matrices (N, m, n)."""
    values = np.asarray(np.linalg.svd(matrices, compute_uv=False), dtype=np.float64)
    return ratio_to_largest(values, matrices.shape[2])


@record(checked="outside")
class Projection:
    """The motion that the loops allow, at N configurations.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.kinematics.project(robot, robot.reference[None])
    >>> found.G.shape, found.singularity.round(2).tolist()
    ((1, 4, 2), [0.71])
    """

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


@record(checked="outside")
class ClosedMotion:
    """Velocities and accelerations that keep the loops closed, at N samples.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> q, rates, still = robot.reference[None], [[1.0, 0.0]], [[0.0, 0.0]]
    >>> moved = loopid.kinematics.closed_motion(robot, q, rates, still)
    >>> moved.velocities.shape, moved.projection.G.shape
    ((1, 4), (1, 4, 2))
    """

    configurations: FloatArray  # (N, nq), closed
    velocities: FloatArray  # (N, nv), v = G u̇ and a = G ü + γ
    accelerations: FloatArray
    gamma: FloatArray  # (N, nv), the part of the accelerations that the velocities cause
    projection: Projection


@checked
def project(
    robot: Robot, configurations: FloatArray, *, independent: Sequence[str] | None = None
) -> Projection:
    """Project the motion onto independent joints, by default the actuated ones.

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (N, nq), closed.
    independent : sequence of str, optional
        Names of the independent joints.

    Returns
    -------
    Projection
        G (N, nv, dof), joint velocities from independent ones.

    Raises
    ------
    MobilityError
        When the independent joints are more than the degrees of freedom.
    SingularityError
        Where the independent joints do not determine the motion.
    DataError
        When a loop is open by more than ``OPEN``, in parts of the robot's length.

    Warns
    -----
    AccuracyWarning
        Where they hardly do: the measure is below ``NEAR_SINGULARITY``.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("3ups_rpu")
    >>> loopid.kinematics.project(robot, robot.reference).G.shape
    (1, 13, 4)
    """
    q = samples(configurations, robot.model.nq, "configurations")
    parts = partition(robot, independent)
    found = [(each.G, each.solver.matrices) for _, each in tangent_spaces(robot, q, parts)]
    G, columns = map(_joined, zip(*found, strict=True))
    return Projection(G, parts[0], columns)


@checked
def closed_motion(
    robot: Robot,
    configurations: FloatArray,
    velocities: FloatArray,
    accelerations: FloatArray,
    *,
    independent: Sequence[str] | None = None,
) -> ClosedMotion:
    """Complete the motion of the independent joints, by default the actuated ones.

    Parameters
    ----------
    robot : Robot
    configurations : FloatArray
        (N, nq), closed.
    velocities, accelerations : FloatArray
        (N, dof) of the independent joints.
    independent : sequence of str, optional
        Their names.

    Returns
    -------
    ClosedMotion
        Velocities and accelerations (N, nv) of all joints.

    Raises
    ------
    DataError, MobilityError, SingularityError
        As ``project``.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("3ups_rpu")
    >>> rates, still = [[0.1, 0, 0, 0]], [[0, 0, 0, 0]]
    >>> motion = loopid.kinematics.closed_motion(robot, robot.reference, rates, still)
    >>> motion.velocities.shape
    (1, 13)
    """
    q = samples(configurations, robot.model.nq, "configurations")
    parts = partition(robot, independent)
    rates = samples(velocities, len(parts[0]), "velocities", len(q))
    second = samples(accelerations, len(parts[0]), "accelerations", len(q))
    found = []
    for rows, each in tangent_spaces(robot, q, parts):
        v = (each.G @ rates[rows, :, None])[:, :, 0]
        found.append((each.G, each.solver.matrices, v, each.gamma(v[:, None])[:, 0]))
    G, columns, v, gamma = map(_joined, zip(*found, strict=True))
    a = (G @ second[:, :, None])[:, :, 0] + gamma
    return ClosedMotion(q, v, a, gamma, Projection(G, parts[0], columns))


@checked
def singularity_measure(robot: Robot, configurations: FloatArray) -> FloatArray:
    """The measure (N,) of ``Projection.singularity``, without refusing singular configurations."""
    _, dependent = partition(robot)
    q = np.atleast_2d(configurations)
    jacobian = scaled_jacobian(robot, constraint_jacobian(robot, q))
    return least_over_largest(jacobian[:, :, dependent])


def partition(robot: Robot, independent: Sequence[str] | None = None) -> tuple[IntArray, IntArray]:
    """Velocity indices of the independent coordinates, the robot's by default, and the rest."""
    return _partition(robot, None if independent is None else tuple(independent))


@derived
def _partition(robot: Robot, independent: tuple[str, ...] | None) -> tuple[IntArray, IntArray]:
    names = robot.independent if independent is None else independent
    chosen = robot.velocity_indices(names)
    if len(set(chosen)) != len(chosen):
        raise MobilityError(f"a joint is twice among {', '.join(names)}", given=tuple(names))
    dependent = np.setdiff1d(np.arange(robot.model.nv), chosen)
    return read_only(chosen), read_only(dependent)


@dataclass(eq=False)
class TangentSpaces:
    """The motion that the loops allow at N configurations."""

    constraint: Constraint
    dependent: IntArray  # velocity indices of the dependent coordinates
    G: FloatArray  # (N, nv, dof)
    solver: Solver  # with the dependent columns A_d

    @classmethod
    def of(cls, constraint: Constraint, parts: tuple[IntArray, IntArray]) -> TangentSpaces:
        """At the configurations of a constraint; ``solver.ill_conditioned`` are in doubt."""
        A = scaled_jacobian(constraint.robot, constraint.jacobian())
        return cls(constraint, parts[1], *velocity_map(constraint.robot, A, *parts))

    def gamma(self, v: FloatArray) -> FloatArray:
        """γ (N, k, nv) at k velocities (N, k, nv) of each: A γ = -Ȧ v."""
        robot, (count, k, nv) = self.constraint.robot, v.shape
        at = self.constraint if k == 1 else self.constraint.repeated(k)
        drift = robot.row_scales * at.drift(v.reshape(-1, nv))
        steps = self.solver.solve(drift.reshape(count, k, drift.shape[1]).swapaxes(1, 2))
        gamma = np.zeros_like(v)
        scales = robot.coordinate_scales.take(self.dependent)
        gamma[:, :, self.dependent] = -scales * steps.swapaxes(1, 2)
        return gamma


def tangent_spaces(
    robot: Robot, q: FloatArray, parts: tuple[IntArray, IntArray]
) -> Iterator[tuple[slice, TangentSpaces]]:
    """All samples, block by block, none of which may be singular, or open."""
    doubts = list[_Doubt]()
    for rows in blocks(len(q)):
        constraint = Constraint(robot, q[rows])
        _require_closed(constraint, "configurations", rows.start)
        found = TangentSpaces.of(constraint, parts)
        if rows.start == 0:
            _refuse_too_many(found.constraint, parts)
        solver = found.solver
        if len(solver.ill_conditioned):
            doubts.append((rows.start + solver.ill_conditioned, solver.factors))
        yield rows, found
    if doubts:
        _refuse_singular(doubts, len(parts[1]))


def _joined(arrays: Sequence[FloatArray]) -> FloatArray:
    """One read-only array, which a record need not copy."""
    whole = np.concatenate(arrays)
    whole.setflags(write=False)
    return whole


def velocity_map(
    robot: Robot, jacobian: FloatArray, chosen: IntArray, dependent: IntArray
) -> tuple[FloatArray, Solver]:
    """G (N, nv, dof) = [I; -A_d⁺ A_u] of Jacobians in common units, and the solver with A_d."""
    scales = robot.coordinate_scales
    solver = Solver.of(jacobian.take(dependent, axis=2), NEAR_SINGULARITY)
    dependent_rows = solver.solve(jacobian.take(chosen, axis=2))
    dependent_rows *= scales.take(dependent)[:, None] / -scales.take(chosen)
    G = np.empty((len(jacobian), len(scales), len(chosen)))
    G[:, chosen], G[:, dependent] = np.eye(len(chosen)), dependent_rows
    return G, solver


def require_closed(robot: Robot, q: FloatArray, name: str) -> None:
    """Refuse a configuration (nq,) whose loops are open: no motion there is one of the robot."""
    _require_closed(Constraint(robot, q[None], jacobians=False), name)


def _require_closed(constraint: Constraint, name: str, first: int = 0) -> None:
    robot = constraint.robot
    residual = np.abs(robot.row_scales * constraint.residual())
    most = max(OPEN * robot.length, 2.0 * robot.closure_residual)
    if residual.max(initial=0.0) > most:
        k, row = np.unravel_index(int(residual.argmax()), residual.shape)
        soft = residual[k, row] <= SOFT * robot.length
        raise DataError(
            f"{name} must be closed, but {robot.row_names[row]} of sample {first + k} is open by "
            f"{residual[k, row]:.3g} m (at most {most:.3g} m): "
            f"{CLOSES if soft else OTHERWISE}",
            argument=name,
            given=float(residual[k, row]),
            tolerance=most,
        )


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


def _refuse_too_many(constraint: Constraint, parts: tuple[IntArray, IntArray]) -> None:
    """Refuse more independent joints than the first sample has degrees of freedom."""
    robot, count = constraint.robot, len(parts[0])
    few = prepared(robot).few_enough
    # No more equations than dependent coordinates have no larger rank.
    if count in few or robot.rows <= len(parts[1]):
        return
    jacobian = scaled_jacobian(robot, constraint.jacobian()[:1])
    rank = Factorisation.of(jacobian, robot.closure_rank_tolerance).rank
    freedom = robot.model.nv - int(rank.max(initial=0))
    if count > freedom:
        hint = ""
        if count == len(robot.independent):  # as many as at the reference
            hint = ", which has more at its reference: that is singular, so give another one"
        raise MobilityError(
            f"{count} independent joints are too many for {counted(freedom, 'degree')} of freedom "
            f"of {robot.name}{hint}",
            given=count,
            freedom=freedom,
        )
    few.add(count)
