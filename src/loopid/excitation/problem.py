"""The optimisation problem: criterion and bounds of a motion, with their slopes.

What a sample contributes depends on its own position, rate and acceleration alone. So all slopes
follow from batches of samples. These are moved a little along one coordinate's position, rate or
acceleration. Three batches a coordinate do, whatever the number of variables. Forces are linear in
accelerations and quadratic in rates. Along positions the loops stay closed to first order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from importlib.util import find_spec
from math import isfinite
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field

from loopid.arguments import FloatArray, Positive
from loopid.errors import OptionError, SingularityError, shown
from loopid.excitation.criteria import CRITERIA, Criterion
from loopid.excitation.limits import Bounds
from loopid.excitation.shapes import SHAPES, Shape
from loopid.identification.force_models import ForceModel
from loopid.kinematics.assembly import AssemblyOptions, try_assemble
from loopid.kinematics.poses import integrate
from loopid.kinematics.projection import ClosedMotion, closed_motion
from loopid.records import record
from loopid.registry import Registry
from loopid.regressors.joint_terms import OF_FILE, JointTerms
from loopid.regressors.motion_regressors import motion_regressor
from loopid.robot.robot import Robot

# Steps of the differences, in parts of a coordinate's unit: half the digits of a double would be
# 1e-8, and closures are left open by the square of the step.
STEP = 1e-6
# Part of the way from one iterate to the next below which a pose counts as out of reach.
SHORTEST_STEP = 2.0**-2
# Coulomb friction has no slope at standstill: over this part of a typical rate it is smoothed.
SMOOTHING = 0.02
# Part of each bound's range, or of its size, that is kept free on the grid of the design, for what
# happens between its samples.
INSET = 0.01
MOST_SIZE = 500  # time and memory grow with its square
# Each lets a search (``search.Search``) go on from variables (n,).
SOLVERS: Registry[Callable[[Any, FloatArray], None]] = Registry(
    "solver",
    {"ipopt": "loopid.excitation.solvers:by_ipopt", "slsqp": "loopid.excitation.solvers:by_slsqp"},
)


@record(kw_only=True, checked=True)
class DesignOptions:
    """How a motion is designed.

    Attributes
    ----------
    criterion : str
        ``"D"``, ``"A"``, ``"E"`` or ``"condition"`` (``Criteria``).
    shape : str
        ``"fourier"``, or ``"poses"`` to stand in, for a gravity model.
    size : int, optional
        Harmonics or poses; by default 6, or twice as many forces as parameters.
    duration : float, optional
        In s; by default 20 for a gravity model, 10 for a full one.
    rate : float
        Samples per second of the run.
    noise : float or mapping, optional
        Standard deviation of each motor's force in N or N m at the rate of the run, one for all or
        by joint (``"all"``: the others); by default that of the logs, or
    noise_share : float
        this part of the root mean square of the motor's force, by the robot file, on the motion
        that the search starts from: drives with current sensors are off by a hundredth or so.
    starts : int
        Random motions to begin with, one after the other; the best result counts.
    evaluations : int
        Of the criterion and the bounds in all, shared by the starts. More never give a worse
        motion.
    time_limit : float, optional
        In s. It only stops: what is found until then does not depend on it.
    solver : str, optional
        ``"ipopt"`` or ``"slsqp"``; by default IPOPT where it is installed.
    seed : int
        Of the random motions.

    Raises
    ------
    OptionError
        When a field is none of what it may be.

    Examples
    --------
    >>> import loopid
    >>> loopid.DesignOptions(duration=6.0, starts=1).evaluations
    400
    """

    criterion: str = "D"
    shape: str = "fourier"
    size: Annotated[int, Field(ge=2, le=MOST_SIZE)] | None = None
    duration: Positive | None = None
    rate: Positive = 100.0
    noise: Positive | Mapping[str, Any] | None = None
    noise_share: Positive = 0.01
    starts: Annotated[int, Field(ge=1)] = 4
    evaluations: Annotated[int, Field(ge=0)] = 400
    time_limit: Positive | None = None
    solver: str | None = None
    seed: Annotated[int, Field(ge=0)] = 0

    def __post_init__(self) -> None:
        OptionError.require("criterion", self.criterion, CRITERIA)
        OptionError.require("shape", self.shape, SHAPES)
        OptionError.require("solver", self.solver or "slsqp", SOLVERS)
        each = self.noise if isinstance(self.noise, Mapping) else {}
        for joint, size in each.items():
            if not (isinstance(size, int | float) and isfinite(size) and size > 0):
                raise OptionError(
                    f"noise must be a number above 0, not {shown(size)} of {joint}",
                    argument="noise",
                    given=self.noise,
                )


def follow(
    robot: Robot, x: FloatArray, v: FloatArray, a: FloatArray, start: FloatArray | None = None
) -> ClosedMotion | None:
    """The motion of all joints from that of the independent ones, (N, dof) each.

    None where the loops do not close, and at singularities. Configurations are reached from others
    (N, nq) or (1, nq), or one after the other from the reference.
    """
    options = AssemblyOptions() if start is None else AssemblyOptions(shortest_step=SHORTEST_STEP)
    found = try_assemble(robot, x, start=start, trajectory=start is None, options=options)
    try:
        return closed_motion(robot, found.configurations, v, a) if found.assembled.all() else None
    except SingularityError:
        return None


class Outcome(NamedTuple):
    """What N samples give."""

    rows: FloatArray  # (N, dof, z), of the weighted regressor
    moving: FloatArray  # (N, moving), bounded quantities in motion
    poses: FloatArray  # (N, others), those of the poses


class Value(NamedTuple):
    """What a motion is worth; slopes df and dg are empty unless required."""

    q: FloatArray  # (N, nq)
    f: float  # the criterion
    g: FloatArray  # (N, k), bounded values in scales
    df: FloatArray  # (m c,)
    dg: FloatArray  # (N k, m c)


@record
class Problem:
    """A motion of the c independent joints to be found: variables y (m c,) in units."""

    force_model: ForceModel
    shape: Shape
    bounds: Bounds
    criterion: Criterion
    noise: FloatArray  # (motors,), standard deviations of the motors' forces
    basis: FloatArray  # (n, z), the z unknown combinations: φ = φ₀ + basis z; the identity for all
    prior: FloatArray  # (z, z), information that there is already
    options: DesignOptions

    @property
    def robot(self) -> Robot:
        """Of the force model."""
        return self.force_model.robot

    @cached_property
    def units(self) -> FloatArray:
        """(c,), unit steps of the joints in m or rad."""
        return self.robot.coordinate_scales[self.robot.velocity_indices(self.robot.independent)]

    @property
    def solver(self) -> str:
        """Of the options, or IPOPT where it is installed."""
        return self.options.solver or ("ipopt" if find_spec("ipyopt") else "slsqp")

    @property
    def samples(self) -> int:
        """How many samples a run of the motion gives."""
        return round(self.shape.seconds * self.options.rate)

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
        return lower[:designed] + INSET, upper[:designed] - INSET

    def keeps_bounds(self, value: Value) -> bool:
        """Whether no bound is broken; half of the inset may be used."""
        lower, upper = self.limits
        return bool(((value.g >= lower - INSET / 2) & (value.g <= upper + INSET / 2)).all())

    def variables(self, y: FloatArray) -> FloatArray:
        """X (m, c) in m or rad."""
        return np.asarray(y.reshape(-1, len(self.units)) * self.units)

    def of_variables(self, X: FloatArray) -> FloatArray:
        """The inverse of ``variables``."""
        return np.asarray((X / self.units).ravel())

    def information(self, rows: FloatArray) -> FloatArray:
        """M (z, z) of the run and what there is already."""
        whole = rows.reshape(-1, rows.shape[2])
        return np.asarray(self.prior + self.samples / len(rows) * whole.T @ whole)

    @cached_property
    def _smooth_terms(self) -> JointTerms | None:
        terms = self.force_model.joint_terms
        if terms is None or terms.smoothing:
            return terms
        robot = self.robot
        gravity = float(np.linalg.norm(robot.model.gravity.linear)) or 1.0
        scale = robot.coordinate_scales[robot.velocity_indices(terms.joints)].min()
        typical = scale * np.sqrt(gravity / robot.length)
        return replace(terms, smoothing=SMOOTHING * typical, dead_zone=0.0)

    def outcome(self, motion: ClosedMotion, poses: int) -> Outcome:
        """Regressor rows and bounded values of a motion.

        Samples after a number of poses repeat these with other rates and accelerations. What
        depends on poses alone is left out there.
        """
        model, first = self.force_model.model, _first(motion, poses)
        static = model != "full" and self.force_model.joint_terms is None  # of the pose alone
        part = first if static else motion
        K = motion_regressor(self.robot, part, model, joint_terms=self._smooth_terms)
        forces = self.forces(motion, K if model == "full" else None)
        moving = self.bounds.in_motion(motion, forces)
        return Outcome(self.rows(part, K), moving, self.bounds.in_poses(first, all_bounds=False))

    def bounded(self, motion: ClosedMotion) -> FloatArray:
        """All bounded values (N, k) of a motion."""
        moving = self.bounds.in_motion(motion, self.forces(motion))
        return np.concatenate([moving, self.bounds.in_poses(motion)], axis=1)

    def rows(self, motion: ClosedMotion, regressor: FloatArray | None = None) -> FloatArray:
        """Forces (N, dof, z) per unit of each unknown, in deviations of their noise."""
        model, robot = self.force_model, self.robot
        if regressor is None:
            regressor = motion_regressor(robot, motion, model.model, joint_terms=model.joint_terms)
        # The motors' share in each force, (N, motors, dof): the identity as a rule.
        shares = motion.projection.G[:, robot.velocity_indices(robot.actuated)]
        deviation = np.sqrt(np.einsum("nmi,m->ni", shares**2, self.noise**2))
        return np.asarray(model.base.regressor(regressor) @ self.basis / deviation[:, :, None])

    def forces(self, motion: ClosedMotion, regressor: FloatArray | None = None) -> FloatArray:
        """Forces of the motors (N, motors) by the robot file; no columns if none is bounded."""
        if not self.bounds.needs_forces:
            return np.zeros((len(motion.configurations), 0))
        return forces_by_file(self.robot, motion, regressor)


def forces_by_file(
    robot: Robot, motion: ClosedMotion, regressor: FloatArray | None = None
) -> FloatArray:
    """Forces of the motors (N, motors) by the robot file; a full regressor may be at hand."""
    K = motion_regressor(robot, motion) if regressor is None else regressor
    pi = robot.standard_parameters()
    forces = K[:, :, : len(pi)] @ pi
    if (terms := JointTerms.of(robot, OF_FILE)) is not None:
        forces += terms.columns(robot, motion) @ np.nan_to_num(terms.values(robot))
    if robot.redundant:
        motors = robot.velocity_indices(robot.actuated)
        shares = motion.projection.G[:, motors].transpose(0, 2, 1)
        forces = (np.linalg.pinv(shares) @ forces[:, :, None])[:, :, 0]
    return np.asarray(forces)


def evaluate(
    problem: Problem, y: FloatArray, near: FloatArray, slopes: bool = True
) -> Value | None:
    """Criterion and bounds, reached from configurations (N or 1, nq); None out of reach."""
    x, v, a = problem.functions @ problem.variables(y)
    motion = follow(problem.robot, x, v, a, near)
    if motion is None:
        return None
    designed = problem.bounds.designed
    scale = problem.bounds.scale[:designed]
    at = problem.outcome(motion, len(x))
    f, P = problem.criterion(problem.information(at.rows))
    g = np.concatenate([at.moving, at.poses], axis=1) / scale
    if not slopes:
        return Value(motion.configurations, f, g, np.empty(0), np.empty(0))
    rows, moving, poses = _state_slopes(problem, motion, v, a, at)
    B, pull = problem.functions, 2 * problem.samples / len(x) * (at.rows @ P)
    df = np.einsum("onm,onc->mc", B, np.einsum("ocnij,nij->onc", rows, pull))
    by_state = np.concatenate([moving, poses], axis=3) / scale  # (3, c, N, k)
    dg = np.einsum("onm,ocnk->nkmc", B, by_state, optimize=True).reshape(g.size, -1)
    return Value(motion.configurations, f, g, df.ravel(), dg)


def _state_slopes(
    problem: Problem, motion: ClosedMotion, v: FloatArray, a: FloatArray, at: Outcome
) -> list[FloatArray]:
    """Slopes (3, c, N, ...) of an outcome by each coordinate's position, rate and acceleration."""
    robot, q, units, G = problem.robot, motion.configurations, problem.units, motion.projection.G
    N, c, unit = len(q), len(units), np.eye(len(units))
    h = STEP * units
    # All moved samples in one batch: positions, rates, accelerations of each coordinate.
    moved = [integrate(robot, q, h[j] * G[:, :, j]) for j in range(c)]
    qs = np.concatenate([*moved, *(2 * c * [q])])
    vs = np.concatenate([*(c * [v]), *(v + h[j] * unit[j] for j in range(c)), *(c * [v])])
    as_ = np.concatenate([*(2 * c * [a]), *(a + units[j] * unit[j] for j in range(c))])
    there = problem.outcome(closed_motion(robot, qs, vs, as_), c * N)

    def slopes(moved: FloatArray, start: FloatArray) -> FloatArray:
        """What was found at all, or only at the first c, moved samples."""
        orders = len(moved) // (c * N)
        found = np.zeros((3, c, *start.shape))
        found[:orders] = moved.reshape(orders, c, *start.shape) - start
        width = np.stack([h, h, units]).reshape(3, c, *(1,) * start.ndim)
        return np.asarray(found / width * units.reshape(c, *(1,) * start.ndim))

    return [slopes(*pair) for pair in zip(there, at, strict=True)]


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
