"""Identification: recordings go in, parameters with intervals come out, judged on new data.

``identify`` is the whole method; each of its steps can be called alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from loopid.arguments import FloatArray, checked, spread_rows
from loopid.errors import DataError, DataWarning, RankError, warn
from loopid.identification.candidate import Candidate, judge, quality_of
from loopid.identification.consistent import (
    CONSISTENT,
    consistent_parameters,
    fit_terms,
    quiet_consistent_fit,
    warn_of_bodies,
)
from loopid.identification.cutoff import CutoffChoice, Sampled
from loopid.identification.data import read, require_no_repetition
from loopid.identification.delay import Delay, InTime, in_time, with_delay_errors
from loopid.identification.estimator import Estimator, WorkingFit, chosen_estimator
from loopid.identification.fitting import fit_in_steps, quiet_fit, working_fit
from loopid.identification.force_models import AUTOMATIC, ForceModel, force_model, samples_of
from loopid.identification.friction import allowing_drives, motor_use, with_friction
from loopid.identification.identification import Identification, split_recordings
from loopid.identification.information import (
    Excitation,
    Identifiability,
    determined_values,
    fit_excited,
    identifiability,
)
from loopid.identification.jackknife import Jackknife
from loopid.identification.leaving_out import predicted_left_out, values_left_out
from loopid.identification.log_mistakes import LogFaults, log_faults_by_log
from loopid.identification.missing import MissingForce, missing_forces, with_missing, with_offsets
from loopid.identification.model_choice import ModelChoice, choose_model
from loopid.identification.options import FitOptions
from loopid.identification.outcome import ALL, ROBOT_FILE
from loopid.identification.plausibility import NOTHING_FOLLOWS, absurdities, nothing_follows
from loopid.identification.problem import FitSamples
from loopid.identification.quality import NoiseModel, fit_quality
from loopid.identification.result import Fit, of_all
from loopid.identification.terms import choose_terms, without_offset
from loopid.logs.recording import Recording, silent_motors
from loopid.motion.joints import JointMotion
from loopid.regressors.motion_regressors import force_parts
from loopid.robot.robot import Robot
from loopid.workers import one_blas_thread

# Part of the forces that the robot file's bodies need, below which forces have another unit; and in
# how many samples that is looked at.
LEAST_FORCES, LOOKED_AT = 1e-4, 100


def warn_of_fitted(training: Sequence[Recording], validation: Sequence[Recording]) -> None:
    """Name recordings that judge what was fitted to them."""
    for run in validation:
        if any(np.array_equal(run.force, other.force) for other in training):
            warn(
                f"{run.name} is fitted and validates: its errors say nothing of new data",
                DataWarning,
            )


def require_forces(robot: Robot, recordings: Sequence[Recording]) -> None:
    """Refuse forces that are none: not used, zero, or far below what the robot's bodies need."""
    driven, needed = len(robot.independent) - len(robot.free), 0.0
    names = ", ".join(run.name for run in recordings)
    forces = np.concatenate([run.force[:, :driven] for run in recordings])
    largest = np.abs(forces).max(axis=0, initial=0.0)
    used = np.concatenate([run.used[:, :driven] for run in recordings]).any(axis=0)
    for run in recordings:
        motion = run.motion.select(spread_rows(len(run), LOOKED_AT))
        state = motion.configurations, motion.velocities, motion.accelerations
        parts = force_parts(robot, *state).total[:, :driven]
        needed = max(needed, float(np.abs(parts).max(initial=0.0)))
    if not used.any():
        silent = ", ".join(silent_motors(recordings) if robot.redundant else ())
        if silent:
            raise DataError(
                f"no force of {names} can be used, as that of {silent}, which works with the other "
                "motors, is zero all along: name the column that has it as 'force' in a mapping, "
                "or leave it out of the motors of the robot"
            )
        raise DataError(
            f"no force of {names} can be used, as all motors stand, are saturated or have a force "
            "of zero all along"
        )
    zero = [robot.independent[k] for k in np.flatnonzero(used & (largest == 0))]
    if zero:
        raise DataError(
            f"the force of {', '.join(zero)} is zero in all samples of {names}: it has no "
            "information, so name the column that has it as 'force' in a mapping"
        )
    most = float(largest.max(initial=0.0))
    if 0 < most < LEAST_FORCES * needed:
        fitting = 10.0 ** round(np.log10(needed / most))
        raise DataError(
            f"the largest force of {names} is {most:.2g} N or N m, but the bodies of the robot "
            f"file need {needed:.2g}: in which unit are the forces, or the file's masses? Give "
            f"that of the forces as 'force_scale' in a mapping ({fitting:.0e} would fit)",
            given=most,
            tolerance=LEAST_FORCES,
        )


@checked
@one_blas_thread()
def identify(
    robot: Robot | ForceModel,
    data: Any,
    *,
    validation: Any = None,
    friction: Any = (),
    references: Sequence[JointMotion] = (),
    mapping: Any = None,
    options: FitOptions = FitOptions(),
) -> Identification:
    """Fit a model of a robot to data, and judge the fit on data that it has not seen.

    Parameters
    ----------
    robot : Robot or ForceModel
        Of a robot the model that the data ask for is fitted (``FitOptions.model``), with the usual
        joint terms.
    data
        A path, a table with columns by name (of pandas or Polars, a dictionary of arrays), a
        ``Log``, a ``Recording``; or a list of these.
    validation : optional
        Judge on these data. By default all data are fitted, and each segment is judged by fits to
        the others (``FitOptions.fraction``).
    friction : optional
        Data of an experiment of their own that the joint terms are identified from first; without
        them all parameters are fitted together.
    references : sequence of JointMotion
        For the estimator ``"iv"``, one a recording: the motion that was commanded, or simulated.
    mapping : LogMapping or path, optional
        Which columns of paths and tables are what.
    options : FitOptions

    Returns
    -------
    Identification
        The recommended fit, its verdict, and the candidates that it was compared with.

    Raises
    ------
    DataError
        Without data, or when they cannot be fitted.
    OptionError
        When the options ask for references that are not given, or the other way round; when they
        choose another model than the one that is given.
    RankError
        Naming the unidentifiable combinations, and the motion that would excite them.

    Warns
    -----
    DataWarning
        Of mistakes in the logs, of a delay that was undone, of unidentifiable combinations that the
        robot file's values are kept for, of weakly identifiable ones, and as ``fit_all``.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")  # with 0.1 N m of friction
    >>> round(found.fit["left_crank_joint.Fc"].value, 2)
    0.1
    """
    options.require_references(len(references))
    options.require_terms(robot)
    others = () if validation is None else validation, friction
    robot, groups = read(robot, data, *others, mapping=mapping)
    require_forces(robot if isinstance(robot, Robot) else robot.robot, groups[0])
    require_no_repetition(groups[0])
    choice, force_model = _model_of(robot, groups[0], options)
    runs = _Runs.of(groups, judged=validation is not None, fraction=options.fraction)
    runs, found, faults = _in_time(force_model, runs, options)
    fitted = {run.name for run in runs.training}
    singular = any(log.singular is not None for log in faults if log.recording in fitted)
    fits = _fitted(force_model, runs, references, found, options, singular=singular)
    fits = fits.with_origin(runs, found.delay, found.cutoff, faults)
    for each in (found.delay, fits.excited):
        if each is not None:
            each.warn()
    warn_of_fitted(runs.training, runs.judging)
    force_model, data, new, judged = _judged(fits, runs, options)
    return Identification(
        *(force_model, *runs[:3], data, new, fits.excited, judged, options),
        cutoff=found.cutoff,
        delay=found.delay,
        log_faults=faults,
        missing=fits.missing,
        choice=choice,
    )


class _Runs(NamedTuple):
    """Recordings by what they are for."""

    training: tuple[Recording, ...]
    judging: tuple[Recording, ...]
    friction: tuple[Recording, ...]
    left_out: bool  # no others judge: each segment is predicted by fits to the rest

    @classmethod
    def of(
        cls, groups: Sequence[tuple[Recording, ...]], *, judged: bool, fraction: float | None
    ) -> _Runs:
        """Of three groups, the first split where a fraction of it is to be fitted."""
        training, judging, friction = groups
        if not judged and fraction is not None:
            training, judging = split_recordings(training, fraction)
        return cls(training, judging, friction, not judged and fraction is None)


def _in_time(
    force_model: ForceModel, runs: _Runs, options: FitOptions
) -> tuple[_Runs, InTime, tuple[LogFaults, ...]]:
    """Recordings without delay, at the best cut-off; what was found of these, and mistakes."""
    robot, undo = force_model.robot, options.undo_delay
    found = in_time(force_model, runs[:3], undo=undo, n_jobs=options.n_jobs)
    faults = log_faults_by_log(robot, [*chain(*found.groups)], force_model.joint_terms)
    for mistake in (finding for log in faults for finding in log.findings):
        mistake.warn()  # before what a wrong log may end in
    if found.cutoff is not None:
        found.cutoff.warn()
    training, judging, friction = found.at_cutoff(robot)
    return _Runs(training, judging, friction, runs.left_out), found, faults


class _Fits(NamedTuple):
    """Fits of a force model to samples, by their names."""

    force_model: ForceModel
    data: FitSamples
    fits: dict[str, Fit]
    refits: Mapping[str, Callable[[FitSamples], FloatArray]]  # values (n,) from some samples
    excited: Identifiability
    missing: tuple[MissingForce, ...]
    regions: FloatArray | None  # errors (dof,) of the consistent one, by estimates without each
    turning: tuple[str, ...]  # joints whose friction changes its sign with speed

    def with_origin(
        self,
        runs: _Runs,
        delay: Delay | None,
        cutoff: CutoffChoice | None,
        faults: Sequence[LogFaults],
    ) -> _Fits:
        """Fits that know what they rest on, with errors that allow for the delay."""
        found = (each for log in faults for each in log.mistakes if each.severity == "mistake")
        origin: dict[str, Any] = {
            "cutoff": None if cutoff is None else cutoff.chosen,
            "use": motor_use(self.force_model, self.data, runs.training),
            "mistakes": tuple(map(str, found)),
            "turning": self.turning,
        }
        fits = {
            name: replace(with_delay_errors(fit, self.data, runs.training, delay), **origin)
            for name, fit in self.fits.items()
        }
        return self._replace(fits=fits)


def _fitted(
    force_model: ForceModel,
    runs: _Runs,
    references: Sequence[JointMotion],
    found: InTime,
    options: FitOptions,
    *,
    singular: bool,
) -> _Fits:
    """The robot file with fitted joint terms, all parameters, and all of solid bodies."""
    force_model, data, first = _sampled(force_model, runs, references, found.first, options)
    plain = force_model.plain_columns
    fitted = plain if first is None else np.setdiff1d(plain, force_model.joint_columns)
    excited = identifiability(force_model, data.select(fitted))
    whole = fit_all(force_model, data, excited, first=first, options=options)
    force_model, turning = allowing_drives(force_model, data, runs.training, whole)
    solid, known, missing, regions = None, None, tuple[MissingForce, ...](), None
    if options.name == "wls":
        if force_model.automatic and first is None:
            force_model, data, solid = with_friction(force_model, data, runs.training, whole)
        else:
            known = whole if first is not None else None
            if first is not None and force_model.automatic:
                force_model, known = _friction_alone(force_model, first, runs.friction, options)
                data = force_model.widened(data, runs.training)
            solid = quiet_consistent_fit(force_model, data, whole.require_noise(), known)
            warn_of_bodies(force_model, solid.result)
        if not singular:  # near such poses errors look like any force
            missing = missing_forces(solid, force_model, runs.training, found.delay)
        regions = _errors_by_region(solid, data)
    least = whole.noise if solid is None else solid.result.noise
    start = fit_joint_terms(force_model, data, noise=least)
    fits = {ROBOT_FILE: start, ALL: of_all(whole, force_model.parameters)}
    if solid is not None:
        offsets = () if first is not None else without_offset(force_model, data)
        allowing = with_missing(with_offsets(solid, offsets), missing)
        assumed = {*allowing.assumed, *(excited.assumed if excited.unidentifiable else ())}
        names = (name for name in force_model.parameters.names if name in assumed)
        fits[CONSISTENT] = replace(allowing, assumed=tuple(names))
    own_data = data if solid is None else solid.samples
    refits = _refits(
        force_model, fits, excited, own_data, first=first, known=known, options=options
    )
    return _Fits(force_model, data, fits, refits, excited, missing, regions, turning)


def _judged(
    fits: _Fits, runs: _Runs, options: FitOptions
) -> tuple[ForceModel, FitSamples, FitSamples, dict[str, Candidate]]:
    """Fits beside the first, on new data; the gears carry the bodies that are recommended."""
    force_model, data, new = fits.force_model, fits.data, fits.data
    left = values_left_out(data, runs.training, fits.refits) if runs.left_out else None
    if not runs.left_out:
        new = samples_of(force_model, runs.judging, n_jobs=options.n_jobs)
    judged = _candidates(fits, data, new, left)
    if CONSISTENT in judged:
        best = fits.fits[ROBOT_FILE if judged[CONSISTENT].loses_to_baseline else CONSISTENT]
        carrying = force_model.with_loads(best.values, best.standard_parameters)
        if carrying is not force_model:
            force_model, data = carrying, carrying.widened(data, runs.training)
            new = data if runs.left_out else carrying.widened(new, runs.judging)
            judged = _candidates(fits, data, new, left)
    dead = nothing_follows(judged[ALL].fit)
    judged = {name: _with_model(each, force_model, data, dead) for name, each in judged.items()}
    return force_model, data, new, judged


def _model_of(
    robot: Robot | ForceModel, recordings: Sequence[Recording], options: FitOptions
) -> tuple[ModelChoice | None, ForceModel]:
    """The model of a robot that recordings ask for; a gravity model that is given is looked at."""
    kind = robot.model if isinstance(robot, ForceModel) else options.model
    own = robot if isinstance(robot, Robot) else robot.robot
    choice = None if kind == "full" else choose_model(own, recordings)
    if choice is not None and kind != AUTOMATIC:
        choice.finding.warn()
    if isinstance(robot, ForceModel):
        return choice, robot
    model = choice.model if choice is not None and kind == AUTOMATIC else kind
    return choice, force_model(own, model, options.terms)


def _sampled(
    force_model: ForceModel,
    runs: _Runs,
    references: Sequence[JointMotion],
    known: Sampled | None,
    options: FitOptions,
) -> tuple[ForceModel, FitSamples, FitSamples | None]:
    """The force model without offsets that are not identifiable, and its samples.

    Those of each recording that is fitted may be known, of the force model that is given.
    """
    n_jobs, alone = options.n_jobs, runs.friction

    def samples(
        model: ForceModel, each: Sequence[FitSamples] = ()
    ) -> tuple[FitSamples, FitSamples | None]:
        data = samples_of(model, runs.training, each=each, references=references, n_jobs=n_jobs)
        return data, samples_of(model, alone, n_jobs=n_jobs) if alone else None

    data, first = samples(force_model, () if known is None else known.samples)
    chosen = choose_terms(force_model, data if first is None else first)
    return chosen, *((data, first) if chosen is force_model else samples(chosen))


def _errors_by_region(fit: WorkingFit, data: FitSamples) -> FloatArray:
    """Root mean squares (dof,) on regions of states of some data, by estimates without each.

    The fit may leave samples out and set a part of forces apart, which its errors on the data hold.
    """
    left_out = Jackknife.of(fit, data.regions)
    return quality_of(data, left_out.predicted(replace(fit, samples=data))).residual_rms


def _refits(
    force_model: ForceModel,
    fits: Mapping[str, Fit],
    excited: Identifiability,
    fitted: FitSamples,
    *,
    first: FitSamples | None,
    known: Fit | None,
    options: FitOptions,
) -> dict[str, Callable[[FitSamples], FloatArray]]:
    """For each candidate, values (n,) from a part of the samples; the errors are those of all.

    ``fitted`` are the samples of the consistent one.
    """

    def terms(part: FitSamples) -> FloatArray:
        noise = fits[ROBOT_FILE].noise
        if noise is None:  # there are none
            return fits[ROBOT_FILE].values
        standard = consistent_parameters(force_model, part, noise, like=fits[ROBOT_FILE])
        return force_model.base.values(standard)

    def every(part: FitSamples) -> FloatArray:
        if first is not None:
            return fit_all(force_model, part, excited, first=first, options=options).values
        values, columns = np.zeros(len(part.parameters)), force_model.plain_columns
        prior, estimator = force_model.prior[columns], chosen_estimator(options.estimator)
        values[columns] = determined_values(
            part.select(columns), prior, excited.excitation, estimator
        )
        return values

    def solid(part: FitSamples) -> FloatArray:
        part = replace(fitted, used=fitted.used & part.used)
        noise = fits[ALL].require_noise()
        if known is not None:
            return quiet_consistent_fit(force_model, part, noise, known).result.values
        standard = consistent_parameters(force_model, part, noise, like=fits[CONSISTENT])
        return force_model.base.values(standard)

    found = {ROBOT_FILE: terms, ALL: every, CONSISTENT: solid}
    return {name: found[name] for name in fits}


def _with_model(
    candidate: Candidate, force_model: ForceModel, data: FitSamples, dead: bool
) -> Candidate:
    """A candidate whose fit of data knows its model, and which laws it breaks.

    ``dead``: no force of the data follows the motion, so that no fit of them is any good.
    """
    fit = replace(candidate.fit, model=force_model)
    broken = *((NOTHING_FOLLOWS,) if dead else ()), *absurdities(fit, data)
    return replace(candidate, fit=replace(fit, broken=broken))


def _friction_alone(
    force_model: ForceModel,
    first: FitSamples,
    friction: Sequence[Recording],
    options: FitOptions,
) -> tuple[ForceModel, Fit]:
    """The terms that come from an experiment of their own, and their values."""
    whole = fit_all(force_model, first, identifiability(force_model, first), options=options)
    model, _, found = with_friction(force_model, first, friction, whole)
    return model, found.result


def _candidates(
    fits: _Fits, data: FitSamples, new: FitSamples, left: Mapping[str, FloatArray] | None
) -> dict[str, Candidate]:
    """Candidates beside the first."""
    forces = {
        name: predicted_left_out(new, left[name]) if left else new.predicted(fit.values)
        for name, fit in fits.fits.items()
    }
    start = fits.fits[ROBOT_FILE]
    judged = dict[str, Candidate]()
    for name, fit in fits.fits.items():
        fitted = replace(fit, quality=fit_quality(data.problem, fit.values))
        both = forces[name], forces[ROBOT_FILE]
        found = judge(fitted, data, new, name=name, against=start, predicted=both)
        # Fits know their errors on data that they have not seen.
        rms, own = found.validation.residual_rms, fits.regions if name == CONSISTENT else None
        fitted = replace(fitted, unseen_rms=rms if own is None else np.fmax(rms, own))
        judged[name] = replace(found, fit=fitted, regions=own)
    return judged


@checked
def fit_all(
    force_model: ForceModel,
    data: FitSamples,
    excited: Identifiability,
    *,
    first: FitSamples | None = None,
    options: FitOptions = FitOptions(),
) -> Fit:
    """Fit all parameters that the data determine, by the estimator of the options.

    Joint terms whose size the evidence decides are zero: it takes a prior to separate them.

    Parameters
    ----------
    force_model : ForceModel
    data : FitSamples
        Of all parameters.
    excited : Identifiability
        Identifiability of those that are fitted to them.
    first : FitSamples, optional
        Of an experiment that the joint terms are taken from.
    options : FitOptions
        Estimator, and what to do of unidentifiable combinations.

    Returns
    -------
    Fit

    Raises
    ------
    RankError
        Naming the unidentifiable combinations, unless they are to keep the robot file's values.

    Warns
    -----
    DataWarning
        Of what data that excite all leave open once they are weighted by the motors' errors.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> model = loopid.force_model(robot, "full", "Fc,Fv")
    >>> data = loopid.identification.samples_of(model, [run])
    >>> excited = loopid.identification.identifiability(model, data)
    >>> fit = loopid.identification.fit_all(model, data, excited)
    >>> round(fit["left_crank_joint.Fc"].value, 2)
    0.1
    """
    estimator, plain = chosen_estimator(options.estimator), force_model.plain_columns
    part = data.select(plain) if len(plain) < len(data.parameters) else data
    if first is not None:
        for step in (identifiability(force_model, first.select(plain)), excited):
            if step.unidentifiable:
                raise step.refusal
        joints = np.intersect1d(force_model.joint_columns, plain)
        known = data.parameters.select(joints).labels
        found = fit_in_steps(first.select(plain), part, known, estimator=estimator)
    elif excited.unidentifiable and (options.unidentifiable == "error" or not excited.rank):
        raise excited.refusal
    else:
        found = fit_determined(
            force_model.prior[plain], part, excited, estimator, options.unidentifiable
        )
    return of_all(found, data.parameters)


def fit_determined(
    prior: FloatArray,
    data: FitSamples,
    excited: Identifiability,
    estimator: Estimator,
    unidentifiable: str,
) -> Fit:
    """Fit what data determine; the rest keeps the robot file's values (n,), or an error."""
    if not excited.unidentifiable:
        try:
            return working_fit(data, estimator).result
        except (DataError, RankError):  # a motor of few rows counts for so much that others do not
            if unidentifiable == "error" or data.problem.freedom < 1:
                raise
    found = fit_excited(data, prior, excited.excitation, estimator=estimator)
    if found.assumed and not excited.unidentifiable:
        warn(
            "weighted by the motors' errors, the data do not determine all of "
            f"{', '.join(found.assumed)}: what is left open keeps the robot file's values",
            DataWarning,
        )
    return found


@checked
def fit_joint_terms(
    force_model: ForceModel, data: FitSamples, noise: NoiseModel | None = None
) -> Fit:
    """Fit the joint terms alone, with the bodies of the robot file: what others have to beat.

    By weighted least squares, whatever estimator others have. Friction and drive inertia are not
    negative. Bodies are ``assumed``: their covariance is zero, their intervals are infinite. Those
    of joint terms hold by how much the bodies seem to be off, by errors beyond the ``noise`` of a
    better fit.

    Parameters
    ----------
    force_model : ForceModel
    data : FitSamples
        Of all parameters.
    noise : NoiseModel, optional
        Of a better fit; by default the fit's own.

    Returns
    -------
    Fit

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> model = loopid.force_model(robot, "full", "Fc,Fv")
    >>> data = loopid.identification.samples_of(model, [run])
    >>> fit = loopid.identification.fit_joint_terms(model, data)
    >>> fit["left_crank_joint.Fc"].value > 0, len(fit.assumed)
    (True, 11)
    """
    values = np.array(force_model.prior)
    joints = np.intersect1d(force_model.joint_columns, force_model.plain_columns)
    left = data.reduced(joints, values)
    # A joint term may lead a combination with bodies, of which the robot file knows a part.
    excitation = Excitation.of(force_model, left.problem) if len(joints) else None
    if excitation is None or not excitation.rank:
        return replace(
            Fit.of(force_model, values),
            estimator=ROBOT_FILE,
            degrees_of_freedom=np.array(float(data.problem.rows)),
            quality=fit_quality(data.problem, values),
            standard_parameters=force_model.standard_prior,
        )
    whole = excitation.rank == len(joints)
    terms = quiet_fit(left) if whole else fit_excited(left, values[joints], excitation)
    found = fit_terms(force_model, data, terms.require_noise(), noise or terms.require_noise())
    return replace(found, estimator=terms.estimator, model=force_model)
