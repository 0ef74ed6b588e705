"""The optimisation problem: criterion and bounds of a motion, with their slopes; and its check.

What a sample contributes depends on its own position, rate and acceleration alone. So all
slopes follow from batches of samples that are moved a little along one coordinate's position, rate
or acceleration: three batches a coordinate, whatever the number of variables. Forces are linear in
accelerations and quadratic in rates. Along positions the loops stay closed to first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import SingularityError
from loopid.excitation.criteria import Criterion
from loopid.excitation.limits import Bounds
from loopid.excitation.shapes import Shape
from loopid.identification.force_model import ForceModel
from loopid.kinematics.assembly import (
    CLOSURE_TOLERANCE,
    AssemblyOptions,
    try_assemble,
)
from loopid.kinematics.constraint import largest_residual
from loopid.kinematics.platform import platform_motion
from loopid.kinematics.poses import integrate
from loopid.kinematics.projection import (
    ClosedMotion,
    closed_motion,
)
from loopid.regressors.closed_loop import motion_regressor
from loopid.regressors.joint_terms import (
    OF_FILE,
    JointTerms,
)

# Steps of the differences, in parts of a coordinate's unit: half the digits of a double would be
# 1e-8, and closures are left open by the square of the step.
STEP = 1e-6
# Part of the way from one iterate to the next below which a pose counts as out of reach.
SHORTEST_STEP = 2.0**-2
# Coulomb friction has no slope at standstill: over this part of a typical rate it is smoothed.
SMOOTHING = 0.02
FULL = "full"
# How much finer the grid of the check is.
FINER = 10
# Part of a bound's scale that is round-off.
ROUND_OFF = 1e-9
# Speeds and accelerations that count as rest.
REST = 1e-6


class Coordinates:
    """The c coordinates that a motion is designed in: joints, or those of the platform."""

    def __init__(self, force_model: ForceModel, names: Sequence[str] | None) -> None:
        self.mechanism = mechanism = force_model.mechanism
        platform = mechanism.platform
        self.on_platform = names is not None and platform is not None and names == platform.names
        self.names = tuple(mechanism.measured if names is None else names)
        if self.on_platform and platform is not None:
            turning = [motion.startswith("r") for motion in platform.motions]
            self.units = np.where(turning, 1.0, mechanism.length)
        else:
            self.units = mechanism.coordinate_scales[mechanism.velocity_indices(self.names)]
        self.independent = mechanism.velocity_indices(mechanism.independent)

    def assemble(self, positions: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """Configurations (N, nq), None where the loops do not close.

        Reached from configurations (N, nq) or (1, nq), or one after the other from the reference.
        """
        names, follow = "platform" if self.on_platform else self.names, start is None
        step = SHORTEST_STEP if start is not None else 2.0**-12
        options = AssemblyOptions(shortest_step=step)
        found = try_assemble(
            self.mechanism, positions, names, start=start, trajectory=follow, options=options
        )
        return found.configurations if found.assembled.all() else None

    def follow(
        self, x: FloatArray, v: FloatArray, a: FloatArray, start: FloatArray | None = None
    ) -> ClosedMotion | None:
        """The motion of all joints, reached as in ``assemble``; None also at singularities."""
        q = self.assemble(x, start)
        try:
            return None if q is None else self.whole(q, v, a)
        except SingularityError:
            return None

    def whole(self, q: FloatArray, rates: FloatArray, seconds: FloatArray) -> ClosedMotion:
        """The motion of all joints from rates and accelerations (N, c)."""
        mechanism = self.mechanism
        if not self.on_platform:
            return closed_motion(mechanism, q, rates, seconds, self.names)
        v, a = platform_motion(mechanism, q, rates, seconds)
        return closed_motion(mechanism, q, v[:, self.independent], a[:, self.independent])

    def tangents(self, motion: ClosedMotion) -> FloatArray:
        """Velocities (N, nv, c) of all joints per unit of each coordinate."""
        if not self.on_platform:
            return motion.projection.G
        q, c = motion.configurations, len(self.names)
        rates = np.tile(np.eye(c), (len(q), 1))
        v, _ = platform_motion(self.mechanism, np.repeat(q, c, axis=0), rates, 0 * rates)
        return np.asarray(v.reshape(len(q), c, -1).transpose(0, 2, 1))


class Outcome(NamedTuple):
    """What N samples give: weighted regressor rows (N, dof, z), and bounded quantities.

    Those in motion (N, moving), and of the poses (N, others).
    """

    rows: FloatArray
    moving: FloatArray
    poses: FloatArray

    @property
    def values(self) -> FloatArray:
        """All (N, k)."""
        return np.concatenate([self.moving, self.poses], axis=1)


class Value(NamedTuple):
    """Configurations (N, nq), criterion f, bounded values (N, k) in scales, slopes if asked for."""

    q: FloatArray
    f: float
    g: FloatArray
    df: FloatArray
    dg: FloatArray


@dataclass(frozen=True, eq=False)
class Problem:
    """Variables y (m c,) of a motion, in units; the criterion, and bounds on a grid of times."""

    force_model: ForceModel
    coordinates: Coordinates
    shape: Shape
    bounds: Bounds
    criterion: Criterion
    noise: FloatArray  # (motors,), standard deviations of the motors' forces
    basis: FloatArray  # (n, z), the z unknown combinations: φ = φ₀ + basis z; the identity for all
    prior: FloatArray  # (z, z), information that there is already
    samples: int  # how many samples a run of the motion gives
    # Part of each bound's scale that is kept free for what happens between the samples
    inset: float = 0.01

    @cached_property
    def time(self) -> FloatArray:
        """(N,)."""
        return self.shape.grid()

    @cached_property
    def functions(self) -> FloatArray:
        """(3, N, m)."""
        return self.shape.functions(self.time)

    @cached_property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper ends (k,) of the bounded values in scales, less the inset."""
        bounds, designed = self.bounds, self.bounds.designed
        lower, upper = (end / bounds.scale for end in (bounds.lower, bounds.upper))
        return lower[:designed] + self.inset, upper[:designed] - self.inset

    def violation(self, value: Value) -> float:
        """How far the worst bound is broken, in scales; half of the inset may be used."""
        lower, upper = self.limits
        inset = self.inset / 2
        broken = np.maximum(lower - inset - value.g, value.g - upper - inset)
        return float(broken.max(initial=-np.inf))

    def variables(self, y: FloatArray) -> FloatArray:
        """X (m, c) in m or rad."""
        return np.asarray(y.reshape(-1, len(self.coordinates.units)) * self.coordinates.units)

    def of_variables(self, X: FloatArray) -> FloatArray:
        """The inverse of ``variables``."""
        return np.asarray((X / self.coordinates.units).ravel())

    @cached_property
    def _terms(self) -> JointTerms | None:
        terms = self.force_model.joint_terms
        if terms is None or terms.smoothing:
            return terms
        mechanism = self.force_model.mechanism
        gravity = float(np.linalg.norm(mechanism.model.gravity.linear)) or 1.0
        scale = mechanism.coordinate_scales[mechanism.velocity_indices(terms.joints)].min()
        typical = scale * np.sqrt(gravity / mechanism.length)
        return replace(terms, smoothing=SMOOTHING * typical, dead_zone=0.0)

    def outcome(self, motion: ClosedMotion, poses: int | None = None) -> Outcome:
        """Regressor rows and bounded values.

        With a number of poses the samples after these repeat them with other rates and
        accelerations: what depends on poses alone is left out there.
        """
        count = len(motion.configurations) if poses is None else poses
        part, K = motion, None
        if self.force_model.model != FULL and self._terms is None:
            part = _first(motion, count)  # static forces do not depend on rates
        elif self.force_model.model == FULL:
            K = self._regressor(motion, self._terms)
        rows, forces = self.rows(part, self._terms, K), None
        if self.bounds.needs_forces:
            forces = self.forces(motion, K)
        moving = self.bounds.in_motion(motion, forces)
        return Outcome(rows, moving, self.bounds.in_poses(motion, count, poses is None))

    def _regressor(self, motion: ClosedMotion, terms: JointTerms | None) -> FloatArray:
        return motion_regressor(
            self.force_model.mechanism, motion, self.force_model.model, joint_terms=terms
        )

    def rows(
        self, motion: ClosedMotion, terms: JointTerms | None, regressor: FloatArray | None = None
    ) -> FloatArray:
        """Forces (N, dof, z) per unit of each unknown, in deviations of their noise."""
        model, mechanism = self.force_model, self.force_model.mechanism
        K = self._regressor(motion, terms) if regressor is None else regressor
        # The motors' share in each force, (N, motors, dof): the identity as a rule.
        shares = motion.projection.G[:, mechanism.velocity_indices(mechanism.actuated)]
        deviation = np.sqrt(np.einsum("nmi,m->ni", shares**2, self.noise**2))
        return np.asarray(model.base.regressor(K) @ self.basis / deviation[:, :, None])

    def forces(self, motion: ClosedMotion, regressor: FloatArray | None = None) -> FloatArray:
        """Forces of the motors (N, motors) by the robot file."""
        mechanism = self.force_model.mechanism
        K = motion_regressor(mechanism, motion) if regressor is None else regressor
        pi = mechanism.standard_parameters()
        forces = K[:, :, : len(pi)] @ pi
        if (terms := JointTerms.of(mechanism, OF_FILE)) is not None:
            forces += terms.columns(mechanism, motion) @ np.nan_to_num(terms.values(mechanism))
        if mechanism.redundant:
            motors = mechanism.velocity_indices(mechanism.actuated)
            shares = motion.projection.G[:, motors].transpose(0, 2, 1)
            forces = (np.linalg.pinv(shares) @ forces[:, :, None])[:, :, 0]
        return np.asarray(forces)

    def motion(self, y: FloatArray, near: FloatArray) -> ClosedMotion | None:
        """The motion on the grid, reached from configurations (N, nq) or (1, nq)."""
        x, v, a = self.functions @ self.variables(y)
        return self.coordinates.follow(x, v, a, near)

    def information(self, rows: FloatArray) -> FloatArray:
        """M (z, z) of the run and what there is already."""
        told = rows.reshape(-1, rows.shape[2])
        return np.asarray(self.prior + self.samples / len(rows) * told.T @ told)


def evaluate(
    problem: Problem, y: FloatArray, near: FloatArray, slopes: bool = True
) -> Value | None:
    """Criterion and bounds at variables y; None where the loops do not close.

    Configurations are reached from those of another motion (N, nq), or of one pose (1, nq).
    """
    motion = problem.motion(y, near)
    if motion is None:
        return None
    N, designed = len(problem.time), problem.bounds.designed
    at, scale = problem.outcome(motion, N), problem.bounds.scale[:designed]
    f, P = problem.criterion(problem.information(at.rows))
    if not slopes:
        return Value(motion.configurations, f, at.values / scale, np.empty(0), np.empty(0))
    _, v, a = problem.functions @ problem.variables(y)
    steps, q = problem.coordinates, motion.configurations
    c, h, unit = len(steps.units), STEP * steps.units, np.eye(len(steps.units))
    # All moved samples in one batch: positions, rates, accelerations of each coordinate.
    tangents = steps.tangents(motion)
    moved = [integrate(steps.mechanism, q, h[j] * tangents[:, :, j]) for j in range(c)]
    qs = np.concatenate([*moved, *(2 * c * [q])])
    vs = np.concatenate([*(c * [v]), *(v + h[j] * unit[j] for j in range(c)), *(c * [v])])
    as_ = np.concatenate([*(2 * c * [a]), *(a + steps.units[j] * unit[j] for j in range(c))])
    there = problem.outcome(steps.whole(qs, vs, as_), c * N)

    def slopes_of(moved: FloatArray, start: FloatArray) -> FloatArray:
        """(3, c, N, ...) of what was found at all, or only at the first c, moved samples."""
        orders = len(moved) // (c * N)
        found = np.zeros((3, c, *start.shape))
        found[:orders] = moved.reshape(orders, c, *start.shape) - start
        width = np.stack([h, h, steps.units]).reshape(3, c, *(1,) * start.ndim)
        return np.asarray(found / width * steps.units.reshape(c, *(1,) * start.ndim))

    pull = 2 * problem.samples / N * (at.rows @ P)
    B = problem.functions  # (3, N, m)
    df = np.einsum("ocnij,nij->onc", slopes_of(there.rows, at.rows), pull)
    dg = [slopes_of(*part) for part in ((there.moving, at.moving), (there.poses, at.poses))]
    by_state = np.concatenate(dg, axis=3) / scale  # (3, c, N, k)
    dg_all = np.einsum("onm,ocnk->nkmc", B, by_state, optimize=True)
    return Value(
        q,
        f,
        at.values / scale,
        np.einsum("onm,onc->mc", B, df).ravel(),
        dg_all.reshape(N * designed, -1),
    )


def _first(motion: ClosedMotion, count: int) -> ClosedMotion:
    """The first samples of a motion."""
    part = motion.projection
    projection = replace(part, G=part.G[:count], dependent_columns=part.dependent_columns[:count])
    return ClosedMotion(
        motion.configurations[:count],
        motion.velocities[:count],
        motion.accelerations[:count],
        motion.gamma[:count],
        projection,
    )


@dataclass(frozen=True)
class Check:
    """A bounded quantity over a whole motion.

    Attributes
    ----------
    name, unit : str
    lowest, highest : float
        Of the motion.
    lower, upper : float
        What it must keep; infinite where there is no end.
    time : float
        When it is nearest to an end, in s.
    violations : int
        Samples at which the bound is broken.
    """

    name: str
    unit: str
    lowest: float
    highest: float
    lower: float
    upper: float
    time: float
    violations: int

    @property
    def used(self) -> float:
        """Part of the way from the middle of the range to its nearer end, or of its only end."""
        if np.isfinite([self.lower, self.upper]).all():
            middle, half = (self.lower + self.upper) / 2, (self.upper - self.lower) / 2
            return max(self.highest - middle, middle - self.lowest) / half
        if np.isfinite(self.lower):
            return self.lower / self.lowest if self.lowest > 0 else np.inf
        return self.highest / self.upper


def check_motion(problem: Problem, X: FloatArray) -> tuple[Check, ...]:
    """Check variables X (m, c) of a motion; empty where it leaves the assembly mode."""
    time = np.linspace(0.0, problem.shape.seconds, FINER * len(problem.time) + 1)
    motion = problem.coordinates.follow(*(problem.shape.functions(time) @ X))
    if motion is None:
        return ()
    mechanism, bounds = problem.force_model.mechanism, problem.bounds
    values = problem.outcome(motion).values
    checks = [
        _check(bound.text, bound.unit, time, column, bound.lower, bound.upper, bound.scale)
        for bound, column in zip(bounds.all, values.T, strict=True)
    ]
    length, largest = mechanism.length, max(CLOSURE_TOLERANCE, 2 * mechanism.closure_residual)
    if mechanism.rows:
        residual = largest_residual(mechanism, motion.configurations)
        checks.append(_check("closure residual", "m", time, residual, -np.inf, largest, length))
    ends = [0, -1]
    speeds = np.abs(np.concatenate([motion.velocities[ends], motion.accelerations[ends]], axis=1))
    resting = speeds.max(axis=1, initial=0.0)
    checks.append(_check("speed at both ends", "", time[ends], resting, -np.inf, REST, 1.0))
    return tuple(checks)


def _check(
    name: str,
    unit: str,
    time: FloatArray,
    values: FloatArray,
    lower: float,
    upper: float,
    scale: float,
) -> Check:
    slack = np.minimum(values - lower, upper - values)
    ends = float(values.min()), float(values.max())
    broken = int((slack < -ROUND_OFF * scale).sum())
    return Check(name, unit, *ends, lower, upper, float(time[int(slack.argmin())]), broken)
