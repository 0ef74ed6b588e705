"""The design of an exciting motion: the best one found in a time, checked on a finer grid.

With it comes what a fit of a log of the motion will tell, with all that preparing and filtering
cost. The log that the run would give without errors is prepared as any log is: filtered, cut at
both ends, thinned out, and without the motors that stand. Weighted least squares of its samples X,
whitened by the weights, have the covariance (XᵀX)⁻¹ HᵀH (XᵀX)⁻¹, where H is X filtered: errors that
are independent in the log are not any more after the filter.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from time import monotonic

import numpy as np
import scipy.linalg

from loopid.arguments import (
    FloatArray,
    checked,
    frozen,
)
from loopid.errors import (
    AccuracyWarning,
    DataWarning,
    OptionError,
    warn,
)
from loopid.excitation.criteria import (
    CRITERIA,
    Criteria,
    Criterion,
    OfCombinations,
)
from loopid.excitation.limits import (
    Bounds,
    Collisions,
    MotionLimits,
)
from loopid.excitation.problem import (
    Check,
    Coordinates,
    Problem,
    check_motion,
)
from loopid.excitation.search import (
    SOLVERS,
    DesignProgress,
    Poses,
    find_poses,
    random_margin,
    searched,
)
from loopid.excitation.shapes import (
    SHAPES,
    PosesShape,
    Shape,
)
from loopid.identification.directions import (
    Excitation,
    excited_samples,
)
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_model import (
    ForceModel,
    find_force_model,
)
from loopid.identification.problem import FitSamples
from loopid.kinematics.assembly import JointCoordinates
from loopid.kinematics.projection import project
from loopid.kinematics.sampling import (
    DEFAULT_MARGIN,
    random_configurations,
)
from loopid.logs.log import Log
from loopid.logs.preparing import prepare_recording
from loopid.logs.recording import Recording
from loopid.motion import joint_motion
from loopid.motion.joints import JointMotion
from loopid.motion.trajectories import (
    Motion,
    Waypoint,
)
from loopid.observation import triangular_factor
from loopid.parameters import ParameterSet
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.mechanism import (
    Mechanism,
    lock_options,
    shortened,
)
from loopid.scratch import row_blocks
from loopid.workers import (
    one_blas_thread,
    require_processes,
)

# Seconds of a motion where nothing else is said.
DURATIONS = {"gravity": 20.0, "full": 10.0}
TIME_LIMIT = 60.0
RATE = 100.0
STARTS = 4
MOST_SIZE = 500
# Random poses, by which margins, reaches and pairs of links are told.
POSES = 128
# Where the finer grid shows a broken bound: parts of the motion's size that are left, of which the
# first are tried at once, and steps back to where the search came from.
SHRINKS = (1.0, *(1 - 0.5 * 0.6**k for k in range(12, -1, -1)), *(0.5**k for k in range(2, 16)))
FIRST = 6
BACK = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89)
# Relative singular values of a payload's columns that count as zero.
DEPENDENT = 1e-9
# Bounds that a warning names.
NAMED_BOUNDS = 3
# Samples whose regressor of all standard parameters is in memory at a time.
CHUNK = 2048
# Relative singular values of an observation that count as zero, and the part of a parameter that
# may lie there.
UNEXCITED, PART_UNEXCITED = 1e-8, 1e-4


@dataclass(frozen=True, eq=False)
class ExpectedFit:
    """Of a run of a motion, and what there was before."""

    standard_errors: FloatArray  # (z,), infinite where nothing tells a parameter
    # (z,), singular values of the weighted observation, its columns scaled to length 1
    spectrum: FloatArray

    @classmethod
    def of(cls, information: FloatArray, errors: FloatArray) -> ExpectedFit:
        """Of triangular factors (z, z): of the weighted observation, and of its filtered one."""
        scale = np.linalg.norm(information, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        _, values, right = np.linalg.svd(information / scale)
        excited = values > UNEXCITED * values[0]
        inverse = (right[excited].T / values[excited] ** 2) @ right[excited]
        spread = np.linalg.norm(errors / scale @ inverse, axis=0) / scale
        unexcited = np.linalg.norm(right[~excited], axis=0) > PART_UNEXCITED
        return cls(np.where(unexcited, np.inf, spread), values)


@dataclass(frozen=True, eq=False, repr=False)
class ExcitationDesign:
    """A motion that excites, with what it promises and keeps.

    Attributes
    ----------
    force_model : ForceModel
    parameters : ParameterSet
        The z parameters that it is to determine.
    limits : MotionLimits
    motion : Motion
        Of the designed coordinates, at the rate of the run.
    joint_motion : JointMotion
        The same, of all joints.
    motors : Motion
        The same, of the actuated joints.
    forces : FloatArray
        (N, motors) in N or N m, by the robot file.
    start, waypoints : FloatArray and tuple of Waypoint
        The motion as a motion file writes it.
    criterion : str
        What was optimised.
    criteria : Criteria
        Of the weighted observation of the motion, with what there was before.
    expected, before : ExpectedFit
        What a fit of a run tells, together with what there was before; and of that alone: of the
        logs, or of the motion that the search started from.
    noise : FloatArray
        (motors,) in N or N m.
    checks : tuple of Check
        All bounds, on a grid ten times finer than that of the design.
    seconds : float
        Time spent.
    solver : str
    evaluations : int
    stopped : bool
        Whether the time was up, or somebody stopped it, before it converged.
    """

    force_model: ForceModel
    parameters: ParameterSet
    limits: MotionLimits
    motion: Motion
    joint_motion: JointMotion
    motors: Motion
    forces: FloatArray
    start: FloatArray
    waypoints: tuple[Waypoint, ...]
    criterion: str
    criteria: Criteria
    expected: ExpectedFit
    before: ExpectedFit
    noise: FloatArray
    checks: tuple[Check, ...]
    after_logs: bool
    seconds: float
    solver: str
    evaluations: int
    stopped: bool

    def __repr__(self) -> str:
        return (
            f"<ExcitationDesign of {self.force_model.mechanism.name}: {self.motion.duration:g} s, "
            f"condition number {self.criteria.condition_number:.4g}, log det "
            f"{self.criteria.log_det:.4g}, {self.violations} violations>"
        )

    @property
    def standard_errors(self) -> FloatArray:
        """(z,) of the parameters by a fit of a run; infinite where nothing tells one."""
        return self.expected.standard_errors

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
def design_excitation(
    robot: Mechanism | ForceModel,
    model: str = "gravity",
    joint_terms: JointTerms | None = None,
    limits: MotionLimits | None = None,
    criterion: str = "D",
    shape: str = "fourier",
    duration: float | None = None,
    size: int | None = None,
    coordinates: str = "joints",
    noise: float | Mapping[str, float] | None = None,
    after: Sequence[Recording] = (),
    parameters: Sequence[str] = (),
    payload: str | None = None,
    rate: float = RATE,
    time_limit: float = TIME_LIMIT,
    starts: int = STARTS,
    iterations: int | None = None,
    seed: int = 0,
    n_jobs: int = 1,
    solver: str | None = None,
    progress: DesignProgress | None = None,
) -> ExcitationDesign:
    """Design a motion of a robot that excites the parameters of its force model.

    Parameters
    ----------
    robot : Mechanism or ForceModel
    model, joint_terms
        Of the force model, as in ``find_force_model``, for a mechanism.
    limits : MotionLimits, optional
        By default those of the robot file.
    criterion : str
        ``"D"``, ``"A"``, ``"E"`` or ``"condition"`` (``Criteria``).
    shape : str
        ``"fourier"``, ``"spline"``, or ``"poses"`` to stand in, for a gravity model.
    duration : float, optional
        In s; by default 20 for a gravity model, 10 for a full one.
    size : int, optional
        Harmonics, waypoints or poses.
    coordinates : str
        ``"joints"``, or ``"platform"`` for the platform coordinates.
    noise : float or mapping, optional
        Standard deviation of each motor's force in N or N m at the rate of the run, one for all or
        by joint (``"all"``: the others); by default that of the logs, or 1.
    after : sequence of Recording
        What there is already: the motion adds to it.
    parameters : sequence of str
        Leading labels of the combinations to excite; all by default.
    payload : str, optional
        The link whose parameters alone are unknown, all others being known.
    rate : float
        Samples per second of the run.
    time_limit : float
        In s.
    starts : int
        Random motions to begin with, one after the other; the best result counts.
    iterations : int, optional
        Evaluations of each start: with it, and enough time, the result does not hang on the clock.
    seed : int
    n_jobs : int
        Processes, each with starts of its own.
    solver : str, optional
        ``"ipopt"`` or ``"slsqp"``; by default IPOPT where it is installed.
    progress : callable, optional
        Called with the seconds spent, those in all, and the best criterion so far.

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
        When IPOPT is asked for and not installed.

    Warns
    -----
    DataWarning
        Naming what the motion does not excite, and the bounds that it uses most.

    Notes
    -----
    Optimal experiments for robots are due to [Gautier1992] and [Swevers1997]; here all
    functions are those of the closed loops.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("parallelogram")
    >>> design = loopid.design_excitation(robot, duration=6.0, starts=1, iterations=10)
    >>> design.violations
    0
    """
    begun = monotonic()
    limits = limits or MotionLimits()
    force_model = (
        robot if isinstance(robot, ForceModel) else find_force_model(robot, model, joint_terms)
    )
    mechanism = force_model.mechanism
    _refuse(force_model, criterion, shape, coordinates, solver, parameters, time_limit, starts)
    require_processes(n_jobs, "n_jobs")
    if iterations is not None and iterations < 0:
        raise OptionError(f"iterations must be 0 at least, not {iterations}")
    duration = DURATIONS[force_model.model] if duration is None else duration
    with one_blas_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)  # of motions that are tried
        basis, unknown = _unknown(force_model, payload)
        deviations, prior = _known(force_model, after, noise, basis, rate)
        configurations = random_configurations(mechanism, POSES, seed, margin=0.0)
        least = limits.singularity
        if least is None:
            least = random_margin(mechanism, configurations, DEFAULT_MARGIN)
        collisions = Collisions(mechanism, configurations) if limits.collisions else None
        slow = force_model.model == "gravity"
        names = None if coordinates == "joints" else mechanism.platform.names  # type: ignore[union-attr]
        made = _shape(shape, duration, size, len(unknown), len(mechanism.independent))
        problem = Problem(
            force_model=force_model,
            coordinates=Coordinates(force_model, names),
            shape=made,
            bounds=Bounds(mechanism, limits, least, slow, collisions, configurations),
            criterion=_criterion(criterion, parameters, unknown, force_model),
            noise=deviations,
            basis=basis,
            prior=prior,
            samples=round(duration * rate),
        )
        poses = find_poses(problem, configurations, seed)
        solver = solver or ("ipopt" if find_spec("ipyopt") else "slsqp")
        clock = begun, begun + time_limit
        found = list(
            searched(problem, poses, solver, clock, starts, iterations, seed, n_jobs, progress)
        )
        best = min(found, key=lambda each: each.criterion)
        X, checks = _repaired(problem, poses, best.trail)
        motion, followed, motors, forces, factor, expected = _run(problem, X, rate)
        if after:
            old = root(prior)
            before = ExpectedFit.of(old, old)
        else:
            before = _run(problem, problem.variables(best.start), rate)[-1]
        start, waypoints = made.waypoints(X)
        _warn_of_unexcited(problem, unknown, expected.standard_errors, checks)
        return ExcitationDesign(
            force_model=force_model,
            parameters=unknown,
            limits=limits,
            motion=motion,
            joint_motion=followed,
            motors=motors,
            forces=frozen(forces),
            start=frozen(start),
            waypoints=tuple(waypoints),
            criterion=criterion,
            criteria=Criteria.of(factor),
            expected=expected,
            before=before,
            noise=frozen(deviations),
            checks=checks,
            after_logs=bool(after),
            seconds=monotonic() - begun,
            solver=solver,
            evaluations=sum(each.evaluations for each in found),
            stopped=any(each.stopped for each in found),
        )


def _run(
    problem: Problem, X: FloatArray, rate: float
) -> tuple[Motion, JointMotion, Motion, FloatArray, FloatArray, ExpectedFit]:
    """The motion with variables X (m, c), of all joints, of the motors, their forces.

    And the triangular factor (z, z) of its weighted observation, and the fit of its log.
    """
    model, space = problem.force_model, problem.coordinates
    mechanism = model.mechanism
    motion = problem.shape.motion(space.names, X, rate)
    indices = mechanism.velocity_indices(mechanism.actuated)
    followed, parts, factor = joint_motion(mechanism, motion), [], root(problem.prior)
    for rows in row_blocks(len(motion), CHUNK):
        state = followed.configurations[rows], motion.velocity[rows], motion.acceleration[rows]
        whole = space.whole(*state)
        v, a = whole.velocities[:, indices], whole.accelerations[:, indices]
        parts.append((v, a, problem.forces(whole)))
        told = problem.rows(whole, model.joint_terms).reshape(-1, len(factor))
        factor = triangular_factor(np.concatenate([factor, told]))
    v, a, forces = (np.concatenate(part) for part in zip(*parts, strict=True))
    read = JointCoordinates(mechanism, mechanism.actuated)
    x = read.read(followed.configurations.copy())
    x[:, read.circular] = np.unwrap(x[:, read.circular], axis=0)
    motors = Motion(mechanism.actuated, motion.time, x, v, a)
    expected = expected_fit(problem, motors, forces, isinstance(problem.shape, PosesShape))
    return motion, followed, motors, forces, factor, expected


def _warn_of_unexcited(
    problem: Problem, unknown: ParameterSet, errors: FloatArray, checks: Sequence[Check]
) -> None:
    """Name what was asked for and no motion was found for, and the bounds that are in the way."""
    missing = ~np.isfinite(errors)
    if isinstance(problem.criterion, OfCombinations):
        missing &= np.any(problem.criterion.rows, axis=0)
    labels = [unknown.labels[j] for j in np.flatnonzero(missing)]
    if labels:
        near = sorted(checks, key=lambda check: -check.used)[:NAMED_BOUNDS]
        bounds = ", ".join(f"{check.name} ({check.used:.0%})" for check in near)
        warn(
            f"the motion of {problem.force_model.mechanism.name} does not excite "
            f"{shortened(labels)}: the bounds that it uses most are {bounds}; widen them, or lock "
            "what cannot move",
            DataWarning,
        )


def _refuse(
    force_model: ForceModel,
    criterion: str,
    shape: str,
    coordinates: str,
    solver: str | None,
    parameters: Sequence[str],
    time_limit: float,
    starts: int,
) -> None:
    mechanism = force_model.mechanism
    for what, given, valid in (
        ("criterion", criterion, CRITERIA),
        ("shape", shape, SHAPES),
        ("coordinates", coordinates, ("joints", "platform")),
        ("solver", solver or "slsqp", SOLVERS),
    ):
        if given not in valid:
            raise OptionError.unknown(what, given, valid)
    if mechanism.free:
        raise OptionError(
            f"no motion of the motors tells what {', '.join(mechanism.free)} of {mechanism.name} "
            f"do, which they leave free: lock them ({lock_options(mechanism)})"
        )
    if coordinates == "platform" and mechanism.platform is None:
        raise OptionError(f"{mechanism.name} declares no platform coordinates: use 'joints'")
    if shape == "poses" and (force_model.model != "gravity" or force_model.joint_terms):
        raise OptionError(
            "standing in poses tells the gravity model without joint terms only: choose the shape "
            "'fourier' or 'spline' here"
        )
    if parameters and criterion != "D":
        raise OptionError(f"chosen parameters have the criterion D, not {criterion}")
    if not time_limit > 0:
        raise OptionError(f"time_limit must be above 0 s, not {time_limit}")
    if starts < 1:
        raise OptionError(f"there must be 1 start at least, not {starts}")


def _unknown(force_model: ForceModel, payload: str | None) -> tuple[FloatArray, ParameterSet]:
    """Basis (n, z) of what is unknown, and the names of its combinations."""
    if payload is None:
        return np.eye(len(force_model.parameters)), force_model.parameters
    all_parameters, M = force_model.base.parameters, force_model.base.matrix
    columns = [j for j, each in enumerate(all_parameters) if each.link == payload]
    if not columns:
        links = dict.fromkeys(each.link for each in all_parameters)
        raise OptionError.unknown("link", payload, links)
    # Its base parameters: columns that are independent of those before.
    scaled = M[:, columns] / np.maximum(np.linalg.norm(M, axis=1, keepdims=True), 1e-300)
    R, order = scipy.linalg.qr(scaled, mode="r", pivoting=True)[-2:]
    sizes = np.abs(np.diag(R))
    rank = int((sizes > DEPENDENT * sizes.max(initial=0.0)).sum())
    if not rank:
        raise OptionError(f"no force depends on the parameters of {payload}: it cannot be found")
    kept = np.array(columns)[np.sort(order[:rank])]
    return M[:, kept], all_parameters.select(kept)


def _known(
    force_model: ForceModel,
    after: Sequence[Recording],
    noise: float | Mapping[str, float] | None,
    basis: FloatArray,
    rate: float,
) -> tuple[FloatArray, FloatArray]:
    """Noise (motors,) of the forces at a rate, and the information (z, z) of the logs.

    Errors of filtered logs are autocorrelated: independent ones at the rate stand for them that
    have as much of an effect on a mean.
    """
    mechanism = force_model.mechanism
    deviations, told = dict.fromkeys(mechanism.actuated, 1.0), None
    if after:
        told = FitSamples.combined([force_model.samples(each) for each in after])
        spacing = float(np.mean([np.median(np.diff(each.motion.time)) for each in after]))
        excitation = Excitation.of(force_model, told.problem)
        found = quiet_fit(excited_samples(told, force_model.prior, excitation)).noise
        if found is None:
            raise AssertionError("fits have a model of the noise")
        for k, name in enumerate(mechanism.independent):
            each = found.samples[k] / found.effective_samples[k]
            size = found.deviation[k] * np.sqrt(each * spacing * rate)
            if name in deviations and size > 0:
                deviations[name] = float(size)
    if isinstance(noise, Mapping):
        for name in noise:
            if name not in deviations and name != "all":
                raise OptionError.unknown("motor", name, deviations)
        deviations = {name: noise.get(name, noise.get("all", x)) for name, x in deviations.items()}
    elif noise is not None:
        deviations = dict.fromkeys(deviations, noise)
    for name, deviation in deviations.items():
        if not deviation > 0:
            raise OptionError(f"the noise of {name} must be above 0, not {deviation}")
    sigma = np.array([deviations[name] for name in mechanism.actuated])
    prior = np.zeros((basis.shape[1], basis.shape[1]))
    if told is not None:
        for k, name in enumerate(mechanism.independent):
            rows = told.problem.factors[k, :, :-1] @ basis / deviations[name]
            prior += rate * spacing * rows.T @ rows
    return sigma, prior


def _shape(kind: str, seconds: float, size: int | None, unknown: int, dof: int) -> Shape:
    """The kind of motion, with variables enough by default."""
    if not 0 < seconds < np.inf:
        raise OptionError(f"duration must be a time above 0 s, not {seconds}")
    default = {"fourier": 6, "spline": 10, "poses": max(8, -(-2 * unknown // dof))}[kind]
    if size is not None and size > MOST_SIZE:
        raise OptionError(
            f"size must be at most {MOST_SIZE}, not {size}: time and memory grow with its square"
        )
    made: Shape = SHAPES[kind](seconds, default if size is None else size)
    return made


def _criterion(
    name: str, wanted: Sequence[str], unknown: ParameterSet, force_model: ForceModel
) -> Criterion:
    """The criterion, of all parameters or of those wanted."""
    if not wanted:
        return CRITERIA[name]
    labels, base, rows = unknown.labels, force_model.base, set[int]()
    for parameter in wanted:
        if parameter in labels:
            rows.add(labels.index(parameter))
            continue
        # A parameter that is part of combinations stands for all of these.
        known = base.parameters.labels
        inside = base.matrix[:, known.index(parameter)] if parameter in known else np.zeros(0)
        found = {base.names[int(j)] for j in np.flatnonzero(inside)} & set(labels)
        if not found:
            raise OptionError.unknown("identifiable parameter", parameter, labels)
        rows |= {labels.index(name) for name in found}
    return OfCombinations(np.eye(len(labels))[sorted(rows)])


def _repaired(
    problem: Problem, poses: Poses, trail: Sequence[FloatArray]
) -> tuple[FloatArray, tuple[Check, ...]]:
    """The best motion that keeps all bounds on the finer grid.

    Of the trail of ever better ones, at first a little and at last a lot shrunk around a pose.
    """
    still, best = problem.shape.still(), problem.variables(trail[-1])
    home = np.outer(still, poses.positions[0])
    middle = np.outer(still, (problem.functions[0] @ best).mean(axis=0))
    earlier = [problem.variables(trail[-1 - k]) for k in BACK if k < len(trail)]
    near = [middle + part * (best - middle) for part in SHRINKS[:FIRST]]
    far = [centre + part * (best - centre) for part in SHRINKS[FIRST:] for centre in (middle, home)]
    for X in (*near, *earlier, *far):
        checks = check_motion(problem, X)
        if checks and not any(check.violations for check in checks):
            return X, checks
    return home, check_motion(problem, home)


def root(information: FloatArray) -> FloatArray:
    """A square root R of M = Rᵀ R."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)


def expected_fit(
    problem: Problem, motors: Motion, forces: FloatArray, standing: bool
) -> ExpectedFit:
    """What a log of the motors' positions and forces (N, motors) will tell.

    Parameters
    ----------
    standing : bool
        Whether forces of motors that stand are taken too.

    Raises
    ------
    LogError
        When the motion is too short.
    """
    model, before = problem.force_model, root(problem.prior)
    mechanism, count = model.mechanism, len(motors)
    log = Log.from_arrays(
        motors.time,
        motors.position,
        forces,
        mechanism.actuated,
        idle_speed=0.0 if standing else None,
    )
    run: Recording = prepare_recording(mechanism, log)
    if run.history is None:
        raise AssertionError("logs are filtered by default")
    samples, rows = model.samples(run), run.history.rows
    G = project(mechanism, run.motion.configurations).G
    shares = G[:, mechanism.velocity_indices(mechanism.actuated)] * problem.noise[:, None]
    weights = 1.0 / np.sqrt((shares**2).sum(axis=1).mean(axis=0))
    X = samples.regressor @ problem.basis * (weights * samples.used)[:, :, None]
    # So many samples of the log for each one that is kept.
    thinned = float(np.median(np.diff(rows)))
    told = np.sqrt(thinned) * X.reshape(-1, X.shape[2])
    information = triangular_factor(np.concatenate([before, told]))
    errors, rate = before, (count - 1) / motors.duration
    for share in shares.transpose(1, 0, 2):
        spread = np.zeros((count, X.shape[2]))
        spread[rows] = thinned * np.einsum("ni,niz->nz", share * weights, X)
        errors = triangular_factor(
            np.concatenate([errors, run.history.lowpass.apply(spread, rate)])
        )
    return ExpectedFit.of(information, errors)
