"""Identification from recordings: all parameters, the essential ones, and a baseline."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from shlex import quote
from typing import TYPE_CHECKING

import numpy as np

from loopid.arguments import (
    FloatArray,
    IntArray,
    checked,
    finite,
)
from loopid.diagnosis.bands import (
    BandSweep,
    band_sweep,
)
from loopid.diagnosis.elimination import (
    Reduction,
    eliminate,
)
from loopid.diagnosis.log_mistakes import (
    Suspicions,
    warn_of_suspicions,
)
from loopid.diagnosis.term_sets import (
    TermComparison,
    compare_terms,
)
from loopid.errors import (
    DataError,
    DataWarning,
    ModelWarning,
    OptionError,
    RankError,
    warn,
)
from loopid.identification.bayes import (
    BayesianRidge,
    evidence_scale,
)
from loopid.identification.fitting import (
    chosen_estimator,
    fit,
    fit_in_steps,
    quiet_fit,
    warn_of_insignificant,
)
from loopid.identification.force_model import (
    PRIOR_DEVIATION,
    ForceModel,
    cad_prior,
    reference_instruments,
)
from loopid.identification.information import (
    Excitation,
    Identifiability,
    fit_excited,
    identifiability,
)
from loopid.identification.instrumental import InstrumentalVariables
from loopid.identification.least_squares import (
    Estimator,
    WeightedLeastSquares,
)
from loopid.identification.problem import FitSamples
from loopid.identification.result import (
    FitResult,
    Quality,
    fit_quality,
)
from loopid.logs.recording import Recording
from loopid.motion.joints import JointMotion
from loopid.parameters import html_table
from loopid.regressors.joint_terms import JointTerms
from loopid.scratch import row_blocks

if TYPE_CHECKING:
    from loopid.identification.consistent import ConsistentFit

# What to do where a combination of parameters is unidentifiable from the data.
UNIDENTIFIABLE = ("error", "prior")
DEFAULT_FRACTION = 0.6  # of each recording's moving samples; the rest validates
# Stretches of time whose errors count as independent of each other: few, hence long, as errors
# are autocorrelated over seconds.
BATCHES = 8
INTERVAL = 1.96  # standard deviations of a normal 95 % interval
# Standard deviation of the robot file, relative to its parameters' sizes, as which it may count by
# the data: a file that is right in most of its bodies need not be in all.
DEVIATIONS = 0.1, 10.0
NO_DIFFERENCE = 1e-9  # smaller ones are round-off


@dataclass(frozen=True, repr=False)
class Candidate:
    """Values for all parameters of a force model, some of them taken from data.

    Attributes
    ----------
    name : str
    fitted : int
        Parameters taken from data; the others are those of the robot file, or zero.
    values : FloatArray
        (n,).
    covariance : FloatArray
        (n, n), zero where nothing was fitted.
    training, validation : Quality
        On the data of the fit, and on others.
    rms_errors : tuple of FloatArray
        Standard errors (dof,) of the rms on training and on validation data, in N or N m.
    error_ratio : tuple of float
        Mean squared validation error, actuators weighted alike, over that of the baseline; and its
        standard error.
    """

    name: str
    fitted: int
    values: FloatArray
    covariance: FloatArray
    training: Quality
    validation: Quality
    rms_errors: tuple[FloatArray, FloatArray]
    error_ratio: tuple[float, float]

    def __repr__(self) -> str:
        ratio, error = self.error_ratio
        return (
            f"Candidate({self.name}: {self.fitted} of {len(self.values)} parameters fitted, "
            f"validation error {ratio:.2f} ± {error:.2f} of the baseline's)"
        )

    @property
    def beats_baseline(self) -> bool:
        """Whether the validation error is smaller by more than two standard errors."""
        ratio, error = self.error_ratio
        return 1.0 - ratio > 2 * error + NO_DIFFERENCE

    @property
    def loses_to_baseline(self) -> bool:
        """Whether the validation error is larger by more than two standard errors."""
        ratio, error = self.error_ratio
        return ratio - 1.0 > 2 * error + NO_DIFFERENCE


@dataclass(frozen=True, repr=False)
class Identification:
    """What recordings say about a mechanism.

    Attributes
    ----------
    force_model : ForceModel
    training, validation : tuple of Recording
    samples : tuple of FitSamples
        The same as samples of a fit.
    fit : FitResult
        All parameters of the force model, by the estimator.
    informed : FitResult or None
        All of them by Bayes, with the robot file as prior and its deviation by the evidence
        (``evidence_scale``); None where another estimator than ``"wls"`` was asked for.
    prior_deviation : float or None
        That deviation, relative to the parameters' sizes.
    sweep : BandSweep or None
        Whether weighted least squares says the same of a narrower band.
    reduction : Reduction
        The essential parameters, by backward elimination.
    candidates : tuple of Candidate
        The robot file with fitted joint terms (the baseline), all parameters, the essential ones,
        all with the robot file as prior.
    identifiability : Identifiability
        What the training data tell of the parameters that were fitted to them.
    consistent : ConsistentFit or None
        Physically consistent parameters, where they were asked for.
    suspicions : tuple of Suspicions
        What may be wrong with each log.
    term_sets : TermComparison or None
        What sets of joint terms buy on the validation data, where it was asked for.
    """

    force_model: ForceModel
    training: tuple[Recording, ...]
    validation: tuple[Recording, ...]
    samples: tuple[FitSamples, FitSamples]
    fit: FitResult
    reduction: Reduction
    candidates: tuple[Candidate, ...]
    identifiability: Identifiability
    consistent: ConsistentFit | None = None
    informed: FitResult | None = None
    prior_deviation: float | None = None
    suspicions: tuple[Suspicions, ...] = ()
    term_sets: TermComparison | None = None
    sweep: BandSweep | None = None

    def __repr__(self) -> str:
        model, found = self.force_model, self.identifiability
        fitted, fresh = (len(samples) for samples in self.samples)
        lines = [
            f"Identification({model.mechanism.name}, {model.model} model by {self.fit.estimator}: "
            f"{fitted} samples fitted, {fresh} to validate)",
            *(
                f"  {each.name}: {each.fitted} parameters fitted, squared error on new data "
                "{:.2f} ± {:.2f} of the robot file's".format(*each.error_ratio)
                for each in self.candidates
            ),
            f"  {found.rank} of {found.structural_rank} combinations excited by the data, "
            f"{found.well_determined} better known than by the robot file",
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head = (
            "candidate",
            "parameters fitted",
            "squared error on new data, of the robot file's",
            "±",
        )
        return html_table(head, [(c.name, c.fitted, *c.error_ratio) for c in self.candidates])

    @property
    def baseline(self) -> Candidate:
        """Bodies of the robot file, joint terms fitted to the training data."""
        return self.candidates[0]

    @property
    def essential(self) -> Candidate:
        """The essential parameters fitted, the others as in the robot file."""
        return self.candidates[2]

    @property
    def recommended(self) -> Candidate:
        """What to predict and to export with.

        All parameters with the robot file as prior, or the baseline where these are clearly worse
        on new data; where an estimator was asked for, all parameters by that.
        """
        if self.informed is None:
            return self.candidates[1]
        return self.candidates[0 if self.candidates[3].loses_to_baseline else 3]

    @property
    def recommended_fit(self) -> FitResult:
        """The recommended values with their uncertainty; bodies of the robot file have none."""
        chosen = self.recommended
        if self.informed is None or chosen is self.candidates[1]:
            return self.fit
        if chosen is self.candidates[3]:
            return self.informed
        labels = self.fit.parameters.labels
        return replace(
            self.informed,
            values=chosen.values,
            covariance=chosen.covariance,
            quality=chosen.training,
            assumed=tuple(labels[j] for j in self.force_model.body_columns),
        )

    @property
    def best(self) -> Candidate:
        """The candidate with the least validation error."""
        return min(self.candidates, key=lambda candidate: candidate.error_ratio[0])


@checked
def split_recordings(
    recordings: Sequence[Recording], fraction: float = DEFAULT_FRACTION
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """The first part of each recording's moving samples for training, the rest for validation.

    Parameters
    ----------
    recordings : sequence of Recording
    fraction : float
        Of the samples of each recording in which a motor moves, between 0 and 1.

    Returns
    -------
    training, validation : tuple of Recording

    Raises
    ------
    OptionError
        When the fraction is not between 0 and 1.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> sine = 0.1 * np.ones((2, 1))
    >>> series = loopid.FourierSeries(robot.actuated, 0.1, np.array([1.7, 0.7]), sine, sine)
    >>> motion = loopid.joint_motion(robot, series.motion(20.0, 10.0))
    >>> force = np.zeros((len(motion.time), 2))
    >>> run = loopid.logs.Recording.of_motion(motion, force, robot.actuated)
    >>> training, validation = loopid.split_recordings([run], 0.75)
    >>> len(run), len(training[0]), len(validation[0])
    (201, 151, 50)
    """
    parts = [recording.split(fraction) for recording in recordings]
    return tuple(part[0] for part in parts), tuple(part[1] for part in parts)


@checked
def identify(
    force_model: ForceModel,
    training: Sequence[Recording],
    validation: Sequence[Recording],
    estimator: Estimator | str = "wls",
    friction: Sequence[Recording] = (),
    n_jobs: int = 1,
    unidentifiable: str = "error",
    references: Sequence[JointMotion] = (),
    prior_deviation: float | None = None,
    consistent: str | None = None,
    repair: bool = False,
    term_sets: Sequence[str] | None = None,
) -> Identification:
    """Fit a force model to recordings, and judge the fit on recordings that it has not seen.

    Parameters
    ----------
    training, validation : sequence of Recording
        See ``split_recordings``.
    estimator : Estimator or str
        A name of ``ESTIMATORS``; ``"bayes"`` takes the robot file as its prior, ``cad_prior``.
    friction : sequence of Recording, optional
        Recordings of an experiment of their own that the joint terms are identified from first;
        without them all parameters are fitted together.
    n_jobs : int
        Processes that compute the regressors; the result is the same to the bit.
    unidentifiable : str
        Where no force of the training data depends on a combination of parameters: ``"error"``, or
        ``"prior"``: fit the others, and keep the robot file's values there. Parameters that have a
        part in it are then ``assumed``, and their intervals infinite.
    references : sequence of JointMotion, optional
        For ``"iv"``, one a training recording: the motion that was commanded, or simulated.
    prior_deviation : float, optional
        For ``"bayes"``: standard deviation of the robot file's parameters, relative to their sizes
        (``cad_prior``); 0.3 by default.
    consistent : str, optional
        Fit physically consistent parameters, too: the regularisation of ``consistent_fit``,
        ``"entropic"``, ``"euclidean"`` or ``"riemannian"``.
    repair : bool
        Whether physically inconsistent bodies of the robot file are repaired for that.
    term_sets : sequence of str, optional
        Compare sets of joint terms on the validation data: the usual ones and these
        (``compare_terms``).

    Raises
    ------
    RankError
        Naming the unidentifiable combinations, and the motion that would excite them.

    Warns
    -----
    DataWarning
        Of unidentifiable combinations that the robot file's values are kept for, and of weakly
        identifiable ones.
    DataWarning
        Of mistakes that would explain the forces of a log clearly better (``suspicions``).

    Examples
    --------
    A five-bar whose log was simulated with friction:

    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> friction = loopid.JointTerms(robot.actuated, ("Fv",))
    >>> sine, cosine = 0.1 * np.random.default_rng(0).normal(size=(2, 2, 4))
    >>> series = loopid.FourierSeries(robot.actuated, 0.02, np.array([1.7, 0.7]), sine, cosine)
    >>> motion = loopid.joint_motion(robot, series.motion(100.0, 5.0))
    >>> noise, values = loopid.Noise(gaussian=0.01), np.array([1.0, 2.0])
    >>> log = loopid.simulate_measurement(
    ...     robot, motion, noise, joint_terms=friction, joint_values=values
    ... )
    >>> run = loopid.logs.Recording.of_motion(motion, log.force, robot.actuated)
    >>> model = loopid.find_force_model(robot, "gravity", friction)
    >>> found = loopid.identify(model, *loopid.split_recordings([run], 0.5))
    >>> np.round(found.fit.values[model.joint_columns], 1)
    array([1., 2.])
    """
    if unidentifiable not in UNIDENTIFIABLE:
        raise OptionError.unknown("unidentifiable", unidentifiable, UNIDENTIFIABLE)
    name = estimator if isinstance(estimator, str) else estimator.name
    wanted = len(training) if name == InstrumentalVariables.name else 0
    if len(references) != wanted:
        raise OptionError(
            f"estimator {name!r} takes {wanted or 'no'} reference motions, one for each recording "
            f"to fit if it is {InstrumentalVariables.name!r}, not {len(references)}"
        )
    for choice in term_sets or ():
        JointTerms.of(force_model.mechanism, choice)  # refused before the work, if at all
    for run in validation:
        if any(np.array_equal(run.force, other.force) for other in training):
            warn(
                f"{run.name} is fitted and validates: its errors say nothing of new data",
                DataWarning,
            )
    looked_at = *training, *validation, *friction
    suspected = warn_of_suspicions(force_model.mechanism, looked_at, force_model.joint_terms)
    samples = _gathered(force_model, training, n_jobs, references)
    data = samples, _gathered(force_model, validation, n_jobs)
    found, keep = identifiability(force_model, training, samples), unidentifiable == "prior"
    excitation, missing = found.excitation, keep and bool(found.unidentifiable)
    if estimator == BayesianRidge.name:
        relative = PRIOR_DEVIATION if prior_deviation is None else prior_deviation
        joint_deviations = excitation.joint_sizes if missing else None
        estimator = BayesianRidge(cad_prior(force_model, relative, None, joint_deviations))
    elif prior_deviation is not None:
        raise OptionError(
            f"a deviation of the robot file is for the estimator {BayesianRidge.name!r}, which has "
            f"it as its prior, not for {estimator!r}"
        )
    chosen = chosen_estimator(estimator)
    if not keep:
        _require_excited(found, chosen)
    if friction:
        first = _gathered(force_model, friction, n_jobs)
        _require_excited(identifiability(force_model, friction, first), chosen)
        found = identifiability(force_model, training, samples.select(force_model.body_columns))
        _require_excited(found, chosen)
        known = [force_model.parameters.labels[j] for j in force_model.joint_columns]
        fitted = fit_in_steps(first, samples, known, chosen)
    elif found.unidentifiable and not isinstance(chosen, BayesianRidge):
        fitted = fit_excited(samples, force_model.prior, excitation, chosen)
        warn_of_insignificant(fitted)
    else:
        try:
            fitted = fit(samples, chosen)
        except RankError as error:
            raise RankError(found.refusal) if found.unidentifiable else error from None
        if missing:
            fitted = replace(fitted, assumed=found.assumed)
    informed, deviation = None, None
    if chosen.name == WeightedLeastSquares.name and force_model.has_masses:
        joint_deviations = excitation.joint_sizes if missing else None
        unit = cad_prior(force_model, 1.0, None, joint_deviations)
        assert fitted.noise is not None
        deviation = evidence_scale(unit, samples.problem, fitted.noise, DEVIATIONS)
        bayes = BayesianRidge(cad_prior(force_model, deviation, None, joint_deviations))
        with warnings.catch_warnings():  # the same as of the first fit
            warnings.simplefilter("ignore")
            if friction:
                informed = fit_in_steps(first, samples, known, bayes)
            else:
                informed = quiet_fit(samples, bayes)
        if missing:
            informed = replace(informed, assumed=found.assumed)
    sweep = None
    if chosen.name == WeightedLeastSquares.name and not (friction or found.unidentifiable):
        sweep = band_sweep(samples, training, fitted)
        if sweep is not None:
            sweep.warn()
    if found.unidentifiable:
        warn(found.unidentifiable_message, DataWarning)
    if found.weak:
        warn(found.weak_message, DataWarning)
    reduction = _reduced(force_model, data, chosen, excitation.held)
    start, spread = _baseline(force_model, samples, chosen)
    excited = len(start) - len(found.unidentifiable)
    essential = len(reduction.columns), reduction.values, reduction.covariance
    candidates = [
        judged("robot file", (len(force_model.joint_columns), start, spread), data, start),
        judged("all parameters", (excited, fitted.values, fitted.covariance), data, start),
        judged("essential parameters", essential, data, start),
    ]
    if informed is not None:
        whole = len(start), informed.values, informed.covariance
        candidates.append(judged("robot file as prior", whole, data, start))
    bodies = None
    if consistent is not None:
        from loopid.identification.consistent import (
            consistent_fit,  # only those who ask for it wait for it
        )

        given = samples.problem, fitted, force_model.base, force_model.standard_prior
        bodies = consistent_fit(*given, regularisation=consistent, repair=repair)
    compared = None
    if term_sets is not None and fitted.noise is not None:
        runs = training, validation, fitted.noise, deviation
        compared = compare_terms(force_model, *runs, term_sets, n_jobs)
        best, own = compared.enough[1], compared.chosen
        if not own.errors[1].as_good:
            warn(
                f"joint terms {own.choice} leave larger errors on new data than {best.choice} "
                f"(squared {own.errors[1].mean:.3g} and {best.errors[1].mean:.3g}), and intervals "
                f"do not hold what no term models: use --terms {quote(best.choice)}, or auto",
                ModelWarning,
            )
    return Identification(
        force_model,
        tuple(training),
        tuple(validation),
        data,
        fitted,
        reduction,
        tuple(candidates),
        found,
        bodies,
        informed,
        deviation,
        suspected,
        compared,
        sweep,
    )


def _gathered(
    force_model: ForceModel,
    recordings: Sequence[Recording],
    n_jobs: int,
    references: Sequence[JointMotion] = (),
) -> FitSamples:
    """All samples of recordings, with instruments if there is a reference motion for each."""
    if not recordings:
        raise DataError("identification needs recordings to fit, and others to validate")
    parts = [force_model.samples(recording, n_jobs) for recording in recordings]
    for k, reference in enumerate(references):
        instruments = reference_instruments(force_model, recordings[k], reference, n_jobs)
        parts[k] = parts[k].with_instruments(instruments)
    return FitSamples.combined(parts)


def _require_excited(found: Identifiability, estimator: Estimator) -> None:
    """Refuse unidentifiable combinations, unless a prior knows of them."""
    if found.unidentifiable and not isinstance(estimator, BayesianRidge):
        raise RankError(found.refusal)


def _baseline(
    force_model: ForceModel, samples: FitSamples, estimator: Estimator
) -> tuple[FloatArray, FloatArray]:
    """Values (n,) and covariance (n, n) with the bodies of the robot file, joint terms fitted."""
    values, joints = force_model.prior.copy(), force_model.joint_columns
    covariance = np.zeros((len(values), len(values)))
    if len(joints):
        # A joint term may lead a combination with bodies, of which the robot file knows a part.
        prior, left = values[joints], samples.reduced(joints, values)
        excitation = Excitation.of(force_model, left.problem)
        if isinstance(estimator, BayesianRidge) or excitation.rank == len(joints):
            terms = quiet_fit(left, estimator)
        else:
            terms = fit_excited(left, prior, excitation, estimator)
        values[joints] = terms.values
        covariance[np.ix_(joints, joints)] = terms.covariance
    return values, covariance


def _reduced(
    force_model: ForceModel,
    data: tuple[FitSamples, FitSamples],
    estimator: Estimator,
    held: IntArray,
) -> Reduction:
    """Eliminate parameters that are not essential, those held (unidentifiable) from the start.

    What is essential is not for a prior to say: weighted least squares stands in for Bayes.
    """
    prior = force_model.prior
    if isinstance(estimator, BayesianRidge):
        estimator = WeightedLeastSquares()
    if not len(held):
        return eliminate(*data, estimator, reference=prior)
    free = np.setdiff1d(np.arange(len(prior)), held)
    training, validation = (part.reduced(free, prior) for part in data)
    found = eliminate(training, validation, estimator, reference=prior[free])

    def whole(values: FloatArray) -> FloatArray:
        all_values = prior.copy()
        all_values[free] = values
        return all_values

    steps = tuple(replace(step, values=whole(step.values)) for step in found.steps)
    chosen = steps[found.steps.index(found.chosen)]
    return Reduction(data[0].parameters, prior, steps, chosen, found.result)


def judged(
    name: str,
    fitted: tuple[int, FloatArray, FloatArray],
    data: tuple[FitSamples, FitSamples],
    baseline: FloatArray,
) -> Candidate:
    """Judge a number of fitted parameters, values (n,) and covariance beside baseline values (n,).

    ``data`` are the samples for training and for validation.
    """
    values, (training, validation) = fitted[1], data
    qualities = fit_quality(training.problem, values), fit_quality(validation.problem, values)
    errors = _rms_errors(training, values), _rms_errors(validation, values)
    return Candidate(name, *fitted, *qualities, errors, _error_ratio(validation, values, baseline))


def _rms_errors(samples: FitSamples, values: FloatArray) -> FloatArray:
    """Standard errors (dof,) of the rms of residuals, to first order; NaN without samples."""
    residual, errors = samples.residual(values), np.full(len(samples.actuators), np.nan)
    for k in np.flatnonzero(samples.problem.samples):
        squares = residual[:, k][samples.used[:, k]] ** 2
        if squares.any():
            errors[k] = _mean_error(squares) / (2 * np.sqrt(squares.mean()))
    return errors


def _error_ratio(
    samples: FitSamples, values: FloatArray, baseline: FloatArray
) -> tuple[float, float]:
    """Ratio of mean squared errors, and its standard error to first order, from paired squares."""
    rms = fit_quality(samples.problem, baseline).residual_rms
    scale, present = np.maximum(rms, samples.least_errors), samples.problem.samples > 0

    def squares(phi: FloatArray, rows: slice) -> FloatArray:
        """Squared errors (L,) of some samples, each actuator in units of its baseline error."""
        residual = samples.force[rows] - samples.regressor[rows] @ phi
        residual = np.where(samples.used[rows], residual, 0.0)[:, present]
        return np.asarray(((residual / scale[present]) ** 2).sum(axis=1))

    own, other = (
        np.concatenate([squares(phi, rows) for rows in row_blocks(len(samples))])
        for phi in (values, baseline)
    )
    ratio = float(own.mean() / other.mean())
    return ratio, _mean_error(own - ratio * other) / float(other.mean())


def _mean_error(series: FloatArray) -> float:
    """Standard error of a mean, from the means of batches; NaN for one."""
    means = [batch.mean() for batch in np.array_split(series, min(BATCHES, len(series)))]
    return float(np.std(means, ddof=1) / np.sqrt(len(means))) if len(means) > 1 else np.nan


@checked
def prediction_error(regressor: FloatArray, covariance: FloatArray) -> FloatArray:
    """Standard errors (N, dof) of the forces that a regressor (N, dof, n) predicts.

    Raises
    ------
    DataError
        When the covariance is not (n, n), or something is not finite.
    """
    # The order of numbers in memory would decide the last bits.
    W = np.ascontiguousarray(finite(regressor, "regressor"))
    C = np.ascontiguousarray(finite(covariance, "covariance"))
    if W.ndim != 3 or C.shape != 2 * W.shape[2:]:
        raise DataError(
            f"a regressor (N, dof, n) needs a covariance (n, n), not {W.shape} and {C.shape}"
        )
    variance = np.einsum("nij,jk,nik->ni", W, C, W, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)


@checked
def prediction_reach(regressor: FloatArray, covariance: FloatArray) -> FloatArray:
    """Half the width (N, dof) of 95 % intervals of predicted forces; see ``prediction_error``."""
    return INTERVAL * prediction_error(regressor, covariance)
