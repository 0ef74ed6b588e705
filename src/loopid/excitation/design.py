"""The design of an exciting motion: the best one found, checked on a finer grid."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from time import monotonic
from typing import Any

import numpy as np

from loopid.arguments import CHUNK, FloatArray, checked, row_blocks
from loopid.errors import AccuracyWarning, DataError, DataWarning, OptionError, warn
from loopid.excitation.criteria import Criteria, OfCombinations, Unknown
from loopid.excitation.limits import Bounds, MotionLimits
from loopid.excitation.problem import DesignOptions, Problem, follow, forces_by_file
from loopid.excitation.search import (
    Check,
    DesignProgress,
    Poses,
    feasible_start,
    find_poses,
    search,
)
from loopid.excitation.shapes import SHAPES, PosesShape
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_models import ForceModel
from loopid.identification.information import Excitation, excited_samples
from loopid.identification.problem import FitSamples
from loopid.kinematics.measured import JointCoordinates
from loopid.kinematics.projection import closed_motion, project, singularity_measure
from loopid.kinematics.sampling import SINGULARITY_THRESHOLD, SamplingOptions, random_configurations
from loopid.logs.log import Log
from loopid.logs.preparing import prepare
from loopid.logs.recording import Recording
from loopid.motion.joints import JointMotion, joint_motion
from loopid.motion.trajectories import Motion, Waypoint
from loopid.observation import triangular_factor
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.robot.robot import lock_options, shortened
from loopid.workers import one_blas_thread

# Seconds of a motion, and sizes, where nothing else is said.
DURATIONS, SIZES = {"gravity": 20.0, "full": 10.0}, {"fourier": 6}
# Random poses, which decide thresholds, reaches and pairs of links.
POSES = 128
# Part of the largest force of a motor, below which another's is round-off.
NO_FORCE = 1e-6
# Relative singular values of an observation that count as zero, and the part of a parameter that
# may lie there.
UNEXCITED, PART_UNEXCITED = 1e-8, 1e-4
LEAST_GAIN = 1.01  # ratio of standard errors below which a design gained nothing


@record(kw_only=True)
class ExcitationDesign:
    """A motion that excites, with what it promises and keeps.

    Attributes
    ----------
    force_model : ForceModel
    parameters : ParameterSet
        The z parameters that it is to determine.
    limits : MotionLimits
    options : DesignOptions
    motion : Motion
        Of the independent joints, at the rate of the run.
    joint_motion : JointMotion
        The same, of all joints.
    motors : Motion
        The same, of the actuated joints.
    forces : FloatArray
        (N, motors) in N or N m, by the robot file.
    start, waypoints : FloatArray and tuple of Waypoint
        The motion as a motion file writes it.
    criteria : Criteria
        Of the weighted observation of the motion, with what there was before.
    standard_errors, errors_before : FloatArray
        (z,) of the parameters by a fit of a run, together with what there was before; and of that
        alone: of the logs, or of the motion that the search started from. Infinite where one is
        undetermined.
    after_logs : bool
        Whether there were logs before.
    noise : FloatArray
        (motors,) in N or N m, at the rate of the run; what the expected errors assume.
    checks : tuple of Check
        All bounds, on a grid ten times finer than that of the design.
    pairs : tuple of pairs of str
        Links whose distance counts: neighbours, and links that are always far apart, do not.
    solver : str
    evaluations : int
    converged : bool
        Whether all starts ended before their evaluations, or the time, were up.
    seconds : float
        Time spent; designs that differ in it alone are equal.
    """

    force_model: ForceModel
    parameters: ParameterSet
    limits: MotionLimits
    options: DesignOptions
    motion: Motion
    joint_motion: JointMotion
    motors: Motion
    forces: FloatArray
    start: FloatArray
    waypoints: tuple[Waypoint, ...]
    criteria: Criteria
    standard_errors: FloatArray
    errors_before: FloatArray
    after_logs: bool
    noise: FloatArray
    checks: tuple[Check, ...]
    pairs: tuple[tuple[str, str], ...]
    solver: str
    evaluations: int
    converged: bool
    seconds: float = field(compare=False)

    def __repr__(self) -> str:
        return (
            f"<ExcitationDesign of {self.force_model.robot.name}: {self.motion.duration:g} s, "
            f"condition number {self.criteria.condition_number:.4g}, log det "
            f"{self.criteria.log_det:.4g}, {self.violations} violations>"
        )

    @property
    def gain(self) -> float:
        """Standard errors before over those with the motion, the median; NaN for none before."""
        before, now = self.errors_before, self.standard_errors
        known = np.isfinite(before) & np.isfinite(now) & (now > 0)
        if (np.isinf(before) & np.isfinite(now)).any():
            return float("inf")  # something is determined that was not
        return float(np.median(before[known] / now[known])) if known.any() else float("nan")

    def require_gain(self) -> None:
        """Refuse, by a DataError, a motion whose errors are not smaller by a hundredth."""
        if not self.gain < LEAST_GAIN:
            return
        earlier = "the logs alone do" if self.after_logs else "the first motion tried does"
        raise DataError(
            f"no motion of {self.motion.duration:g} s was found that excites more than {earlier}: "
            f"allow more evaluations={4 * max(self.evaluations, 1)}, or a longer "
            f"duration={2 * self.motion.duration:g}",
            given=self.gain,
            tolerance=LEAST_GAIN,
        )

    @property
    def violations(self) -> int:
        """Samples of the finer grid at which a bound is broken, over all bounds."""
        return sum(check.violations for check in self.checks)

    @property
    def min_singularity_measure(self) -> float:
        """Least singularity measure on the finer grid; 1 for a robot without loops."""
        found = [check.lowest for check in self.checks if check.name == "singularity measure"]
        return found[0] if found else 1.0


@checked
def design_motion(
    model: ForceModel,
    *,
    limits: MotionLimits = MotionLimits(),
    options: DesignOptions = DesignOptions(),
    after: Sequence[Recording] = (),
    parameters: Sequence[str] = (),
    payload: str | None = None,
    progress: DesignProgress | None = None,
) -> ExcitationDesign:
    """Design a motion that excites the parameters of a force model.

    Parameters
    ----------
    model : ForceModel
    limits : MotionLimits
        Beside those of the robot file.
    options : DesignOptions
    after : sequence of Recording
        What there is already: the motion adds to it.
    parameters : sequence of str
        Leading labels of the combinations to excite; all by default.
    payload : str, optional
        The link whose parameters alone are unknown, all others being known.
    progress : callable, optional
        Called with the evaluations done, those in all, and the best criterion so far.

    Returns
    -------
    ExcitationDesign
        Without violations; Ctrl-C returns the best one so far.

    Raises
    ------
    OptionError
        When an option is unknown, or the motors leave coordinates free.
    AssemblyError
        Naming the bound that no pose of the robot keeps.
    MissingExtraError
        When IPOPT is chosen and not installed.

    Warns
    -----
    DataWarning
        Naming what the motion does not excite, and the limit that it comes nearest to.

    Notes
    -----
    Optimal experiments for robots are due to [Gautier1992] and [Swevers1997]; here all
    functions are those of the closed loops.

    Examples
    --------
    >>> import loopid
    >>> model = loopid.force_model(loopid.load("parallelogram"), joint_terms=None)
    >>> options = loopid.DesignOptions(duration=6.0, starts=1, evaluations=10)
    >>> loopid.design_motion(model, options=options).violations
    0
    """
    begun, model = monotonic(), model.plain  # what the evidence weighs is no aim of a motion
    _require_designable(model, options, parameters)
    with one_blas_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)  # of motions that are tried
        unknown = Unknown.of(model, payload)
        poses = random_configurations(
            model.robot,
            POSES,
            seed=options.seed,
            options=SamplingOptions(singularity_threshold=0.0),
        )
        criterion = unknown.criterion(options.criterion, parameters, model)
        size = options.size or SIZES.get(options.shape)
        if size is None:  # poses, twice as many forces as parameters
            size = max(8, -(-2 * len(unknown.parameters) // len(model.robot.independent)))
        problem = Problem(
            force_model=model,
            shape=SHAPES[options.shape](options.duration or DURATIONS[model.model], size),
            bounds=Bounds(
                model.robot, _with_threshold(limits, model, poses), poses, model.model == "gravity"
            ),
            criterion=criterion,
            noise=np.ones(len(model.robot.actuated)),
            basis=unknown.basis,
            prior=np.zeros((unknown.basis.shape[1],) * 2),
            options=options,
        )
        regular = find_poses(problem, poses)
        noise, information = _known_before(problem, _assumed_noise(problem, regular), after)
        problem = replace(problem, noise=noise, prior=information)
        found = search(problem, regular, progress)
        run = _run(problem, found.X)
        if after:
            before = _errors(_root(information), _root(information))
        else:
            before = _run(problem, found.start)["standard_errors"]
    start, waypoints = problem.shape.waypoints(found.X)
    _warn_of_unexcited(problem, unknown.parameters, run["standard_errors"], found.checks)
    return ExcitationDesign(
        force_model=model,
        parameters=unknown.parameters,
        limits=limits,
        options=options,
        **run,
        start=start,
        waypoints=tuple(waypoints),
        errors_before=before,
        after_logs=bool(after),
        noise=noise,
        checks=found.checks,
        pairs=problem.bounds.pairs,
        solver=problem.solver,
        evaluations=found.evaluations,
        converged=found.converged,
        seconds=monotonic() - begun,
    )


def _require_designable(
    model: ForceModel, options: DesignOptions, parameters: Sequence[str]
) -> None:
    """Refuse options that do not go with the model."""
    robot = model.robot
    if robot.free:
        raise OptionError(
            f"no motion of the motors determines what {', '.join(robot.free)} of {robot.name} "
            f"do, which they leave free: load it with {lock_options(robot)}",
            free=robot.free,
        )
    if options.shape == "poses" and (model.model != "gravity" or model.joint_terms):
        raise OptionError(
            "standing in poses identifies the gravity model without joint terms only: use "
            "shape='fourier' here",
            given="poses",
            valid=("fourier",),
        )
    if parameters and options.criterion != "D":
        raise OptionError(
            f"chosen parameters have the criterion D, not {options.criterion}",
            given=options.criterion,
            valid=("D",),
        )


def _assumed_noise(problem: Problem, poses: Poses) -> FloatArray:
    """Deviations (motors,): a share of the forces on a feasible motion, or of the largest one."""
    robot = problem.robot
    y, near = feasible_start(problem, poses, 0)
    x, v, a = problem.functions @ problem.variables(y)
    motion = follow(robot, x, v, a, near)
    sizes = np.zeros(len(robot.actuated))
    if motion is not None:
        sizes = np.sqrt((forces_by_file(robot, motion) ** 2).mean(axis=0))
    largest = sizes.max()
    known = sizes > NO_FORCE * largest
    return problem.options.noise_share * np.where(known, sizes, largest or 1.0)


def _known_before(
    problem: Problem, assumed: FloatArray, after: Sequence[Recording]
) -> tuple[FloatArray, FloatArray]:
    """Deviations (motors,) of the forces at the rate of the run, and information (z, z) of logs.

    The noise is what is given, else that of the logs, else assumed (motors,). Errors of filtered
    logs are autocorrelated. Independent ones at the rate stand for them that have as much of an
    effect on a mean.
    """
    robot, model, options = problem.robot, problem.force_model, problem.options
    noise, basis = options.noise, problem.basis
    deviations = dict(zip(robot.actuated, assumed.tolist(), strict=True))
    known = FitSamples.combined([model.samples(each) for each in after]) if after else None
    spacing = 0.0
    if known is not None:
        spacing = float(np.mean([np.median(np.diff(each.motion.time)) for each in after]))
        excitation = Excitation.of(model, known.problem)
        found = quiet_fit(excited_samples(known, model.prior, excitation)).noise
        assert found is not None
        for k, name in enumerate(robot.independent):
            each = found.samples[k] / found.effective_samples[k]
            size = found.deviation[k] * np.sqrt(each * spacing * options.rate)
            if name in deviations and size > 0:
                deviations[name] = float(size)
    given = noise if isinstance(noise, Mapping) else {} if noise is None else {"all": noise}
    for name in given:
        if name not in deviations and name != "all":
            raise OptionError.unknown("motor", name, deviations)
    deviations = {n: given.get(n, given.get("all", own)) for n, own in deviations.items()}
    information = np.zeros((basis.shape[1], basis.shape[1]))
    if known is not None:
        for k, name in enumerate(robot.independent):
            rows = known.problem.factors[k, :, :-1] @ basis / deviations[name]
            information += options.rate * spacing * rows.T @ rows
    return np.array([deviations[name] for name in robot.actuated]), information


def _with_threshold(limits: MotionLimits, model: ForceModel, poses: FloatArray) -> MotionLimits:
    """Limits with a singularity measure that most poses (N, nq) keep, unless one is given."""
    if limits.singularity_threshold is not None:
        return limits
    least = SINGULARITY_THRESHOLD
    if model.robot.rows:
        least = min(least, float(np.median(singularity_measure(model.robot, poses))) / 2)
    return replace(limits, singularity_threshold=least)


def _warn_of_unexcited(
    problem: Problem, unknown: ParameterSet, errors: FloatArray, checks: Sequence[Check]
) -> None:
    """Name what was required and no motion was found for, and the bound that is in the way."""
    missing = ~np.isfinite(errors)
    if isinstance(problem.criterion, OfCombinations):
        missing &= np.any(problem.criterion.rows, axis=0)
    labels = [unknown.labels[j] for j in np.flatnonzero(missing)]
    if labels:
        # In scales; checks of what is no bound come last.
        bounds = zip(checks, problem.bounds.all, strict=False)
        left = {
            check.name: min(check.lowest - check.lower, check.upper - check.highest) / bound.scale
            for check, bound in bounds
        }
        nearest = min(left, key=left.__getitem__, default="")
        of_these = f", of which that of the {nearest} is nearest," * bool(nearest)
        warn(
            f"the motion of {problem.robot.name} does not excite {shortened(labels)}: widen its "
            f"limits{of_these} or lock what cannot move",
            DataWarning,
        )


def _run(problem: Problem, X: FloatArray) -> dict[str, Any]:
    """Of an ``ExcitationDesign``, what a run of the motion with variables X (m, c) gives."""
    robot = problem.robot
    motion = problem.shape.motion(robot.independent, X, problem.options.rate)
    followed, factor = joint_motion(robot, motion), _root(problem.prior)
    indices, parts = robot.velocity_indices(robot.actuated), []
    for rows in row_blocks(len(motion), CHUNK):
        state = followed.configurations[rows], motion.velocity[rows], motion.acceleration[rows]
        whole = closed_motion(robot, *state)
        forces = forces_by_file(robot, whole)
        parts.append((whole.velocities[:, indices], whole.accelerations[:, indices], forces))
        weighted = problem.rows(whole).reshape(-1, len(factor))
        factor = triangular_factor(np.concatenate([factor, weighted]))
    v, a, forces = (np.concatenate(part) for part in zip(*parts, strict=True))
    read = JointCoordinates(robot, robot.actuated)
    x = read.read(followed.configurations.copy())
    x[:, read.circular] = np.unwrap(x[:, read.circular], axis=0)
    motors = Motion(robot.actuated, motion.time, x, v, a)
    return {
        **{"motion": motion, "joint_motion": followed, "motors": motors, "forces": forces},
        "criteria": Criteria.of(factor),
        "standard_errors": _expected_errors(problem, motors, forces),
    }


def _expected_errors(problem: Problem, motors: Motion, forces: FloatArray) -> FloatArray:
    """Information in a log of the motors' positions and forces (N, motors).

    The log that the run would give without errors is prepared as any log is. It is filtered, cut at
    both ends, thinned out, and without the motors that stand. Weighted least squares of its samples
    X, whitened by the weights, have the covariance (XᵀX)⁻¹ HᵀH (XᵀX)⁻¹, where H is X filtered.
    Errors that are independent in the log are not any more after the filter.
    """
    model, count, before = problem.force_model, len(motors), _root(problem.prior)
    robot = model.robot
    # In poses, forces of motors that stand are taken too; so they are where none can move.
    still = isinstance(problem.shape, PosesShape) or not np.ptp(motors.position, axis=0).any()
    idle_speed = 0.0 if still else None
    log = Log.from_arrays(
        motors.time, motors.position, forces, robot.actuated, idle_speed=idle_speed
    )
    # Its values are those of the robot, perhaps at rest.
    run: Recording = prepare(robot, replace(log, checked=True))
    history = run.history
    assert history is not None  # logs are filtered by default
    samples = model.samples(run)
    G = project(robot, run.motion.configurations).G
    shares = G[:, robot.velocity_indices(robot.actuated)] * problem.noise[:, None]
    weights = 1.0 / np.sqrt((shares**2).sum(axis=1).mean(axis=0))
    X = samples.regressor @ problem.basis * (weights * samples.used)[:, :, None]
    # This many samples of the log for each one that is kept.
    thinned = float(np.median(np.diff(history.rows)))
    weighted = np.sqrt(thinned) * X.reshape(-1, X.shape[2])
    information = triangular_factor(np.concatenate([before, weighted]))
    errors, rate = before, (count - 1) / motors.duration
    for share in shares.transpose(1, 0, 2):
        spread = np.zeros((count, X.shape[2]))
        spread[history.rows] = thinned * np.einsum("ni,niz->nz", share * weights, X)
        filtered = history.lowpass.apply(spread, rate)
        errors = triangular_factor(np.concatenate([errors, filtered]))
    return _errors(information, errors)


def _errors(information: FloatArray, errors: FloatArray) -> FloatArray:
    """Standard errors (z,) by triangular factors (z, z) of the weighted and the filtered columns.

    Infinite where a parameter is undetermined.
    """
    scale = np.linalg.norm(information, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    _, values, right = np.linalg.svd(information / scale)
    excited = values > UNEXCITED * values[0]
    inverse = (right[excited].T / values[excited] ** 2) @ right[excited]
    spread = np.linalg.norm(errors / scale @ inverse, axis=0) / scale
    unexcited = np.linalg.norm(right[~excited], axis=0) > PART_UNEXCITED
    return np.where(unexcited, np.inf, spread)


def _root(information: FloatArray) -> FloatArray:
    """A square root R of M = Rᵀ R."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
