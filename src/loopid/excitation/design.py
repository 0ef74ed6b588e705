"""The design of an exciting motion: the best one found, checked on a finer grid."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import field
from importlib.util import find_spec
from time import monotonic

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import AccuracyWarning, DataWarning, OptionError, warn
from loopid.excitation.checks import Check
from loopid.excitation.criteria import Criteria, OfCombinations
from loopid.excitation.expected import ExpectedFit, root, run_of
from loopid.excitation.limits import Bounds, MotionLimits
from loopid.excitation.options import DesignOptions
from loopid.excitation.problem import Coordinates, Problem
from loopid.excitation.search import DesignProgress, search
from loopid.excitation.shapes import SHAPES, Shape
from loopid.excitation.starts import find_poses, random_margin
from loopid.excitation.unknown import Known, Unknown
from loopid.identification.force_model import ForceModel
from loopid.kinematics.sampling import DEFAULT_MARGIN, SamplingOptions, random_configurations
from loopid.logs.recording import Recording
from loopid.motion.joints import JointMotion
from loopid.motion.trajectories import Motion, Waypoint
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.robot.mechanism import shortened
from loopid.workers import one_blas_thread

# Seconds of a motion where nothing else is said.
DURATIONS = {"gravity": 20.0, "full": 10.0}
# Random poses, by which margins, reaches and pairs of links are told.
POSES = 128
# Bounds that a warning names.
NAMED_BOUNDS = 3


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
        Of the designed coordinates, at the rate of the run.
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
    expected, before : ExpectedFit
        What a fit of a run tells, together with what there was before; and of that alone: of the
        logs, or of the motion that the search started from.
    after_logs : bool
        Whether there were logs before.
    noise : FloatArray
        (motors,) in N or N m.
    checks : tuple of Check
        All bounds, on a grid ten times finer than that of the design.
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
    expected: ExpectedFit
    before: ExpectedFit
    after_logs: bool
    noise: FloatArray
    checks: tuple[Check, ...]
    solver: str
    evaluations: int
    converged: bool
    seconds: float = field(compare=False)

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
    model: ForceModel,
    *,
    limits: MotionLimits = MotionLimits(),  # noqa: B008 (a record)
    options: DesignOptions = DesignOptions(),  # noqa: B008
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
    >>> model = loopid.find_force_model(loopid.load_mechanism("parallelogram"), joint_terms=None)
    >>> options = loopid.DesignOptions(duration=6.0, starts=1, evaluations=10)
    >>> loopid.design_excitation(model, options=options).violations
    0
    """
    begun = monotonic()
    _require_designable(model, options, parameters)
    solver = options.solver or ("ipopt" if find_spec("ipyopt") else "slsqp")
    with one_blas_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)  # of motions that are tried
        unknown = Unknown.of(model, payload)
        known = Known.of(model, unknown.basis, options.rate, noise=options.noise, after=after)
        poses = random_configurations(
            model.mechanism, POSES, options.seed, options=SamplingOptions(margin=0.0)
        )
        problem = _problem(model, limits, options, unknown, known, poses, parameters)
        regular = find_poses(problem, poses, options.seed)
        found = search(problem, regular, options, solver, progress)
        run = run_of(problem, found.X, options.rate)
        if after:
            before = ExpectedFit.of(root(known.information), root(known.information))
        else:
            before = run_of(problem, found.start, options.rate).expected
    start, waypoints = problem.shape.waypoints(found.X)
    _warn_of_unexcited(problem, unknown.parameters, run.expected.standard_errors, found.checks)
    return ExcitationDesign(
        force_model=model,
        parameters=unknown.parameters,
        limits=limits,
        options=options,
        motion=run.motion,
        joint_motion=run.joint_motion,
        motors=run.motors,
        forces=run.forces,
        start=start,
        waypoints=tuple(waypoints),
        criteria=run.criteria,
        expected=run.expected,
        before=before,
        after_logs=bool(after),
        noise=known.noise,
        checks=found.checks,
        solver=solver,
        evaluations=found.evaluations,
        converged=found.converged,
        seconds=monotonic() - begun,
    )


def _require_designable(
    model: ForceModel, options: DesignOptions, parameters: Sequence[str]
) -> None:
    """Refuse options that do not go with the model."""
    mechanism = model.mechanism
    if mechanism.free:
        raise OptionError(
            f"no motion of the motors tells what {', '.join(mechanism.free)} of {mechanism.name} "
            f"do, which they leave free: load it with lock={list(mechanism.free)}",
            free=mechanism.free,
            lock=list(mechanism.free),
        )
    if options.coordinates == "platform" and mechanism.platform is None:
        raise OptionError(
            f"{mechanism.name} declares no platform coordinates: use coordinates='joints'",
            given="platform",
            valid=("joints",),
        )
    if options.shape == "poses" and (model.model != "gravity" or model.joint_terms):
        raise OptionError(
            "standing in poses tells the gravity model without joint terms only: use "
            "shape='fourier' or 'spline' here",
            given="poses",
            valid=("fourier", "spline"),
        )
    if parameters and options.criterion != "D":
        raise OptionError(
            f"chosen parameters have the criterion D, not {options.criterion}",
            given=options.criterion,
            valid=("D",),
        )


def _problem(
    model: ForceModel,
    limits: MotionLimits,
    options: DesignOptions,
    unknown: Unknown,
    known: Known,
    poses: FloatArray,
    parameters: Sequence[str],
) -> Problem:
    """The optimisation problem, with bounds told by random poses (N, nq)."""
    mechanism, platform = model.mechanism, model.mechanism.platform
    on_platform = options.coordinates == "platform" and platform is not None
    shape, least = _shape(model, options, len(unknown.parameters)), limits.singularity
    if least is None:
        least = random_margin(mechanism, poses, DEFAULT_MARGIN)
    return Problem(
        force_model=model,
        coordinates=Coordinates(model, platform.names if on_platform and platform else None),
        shape=shape,
        bounds=Bounds(mechanism, limits, least, model.model == "gravity", poses),
        criterion=unknown.criterion(options.criterion, parameters, model),
        noise=known.noise,
        basis=unknown.basis,
        prior=known.information,
        samples=round(shape.seconds * options.rate),
        inset=options.inset,
    )


def _shape(model: ForceModel, options: DesignOptions, unknown: int) -> Shape:
    """The kind of motion, with variables enough by default."""
    enough = max(8, -(-2 * unknown // len(model.mechanism.independent)))
    size = options.size or {"fourier": 6, "spline": 10, "poses": enough}[options.shape]
    return SHAPES[options.shape](options.duration or DURATIONS[model.model], size)


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
