"""Identification from recordings: all parameters, those that the data support, and a baseline."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

from loopid.arguments import checked
from loopid.errors import ExcitationWarning, OptionError, RankError
from loopid.experiment.candidate import Candidate, judge
from loopid.experiment.consistent import fit_consistent
from loopid.experiment.fits import estimator_for, fit_baseline, fit_shown, reduce_shown
from loopid.experiment.force_model import ForceModel
from loopid.experiment.gathering import gathered_samples, require_references
from loopid.experiment.identifiability import DataSupport, data_support
from loopid.experiment.identification import Identification
from loopid.identification import (
    BayesianRidge,
    Estimator,
    FitResult,
    FitSamples,
    Reduction,
    fit,
    fit_in_steps,
    warn_of_insignificant,
)
from loopid.logs import Recording
from loopid.trajectories import JointMotion

# What to do where no force of the data depends on a combination of parameters.
ON_DARK = ("refuse", "truncate")


@checked
def identify(
    force_model: ForceModel,
    training: Sequence[Recording],
    validation: Sequence[Recording],
    estimator: Estimator | str = "wls",
    friction: Sequence[Recording] = (),
    n_jobs: int = 1,
    on_dark: str = "refuse",
    references: Sequence[JointMotion] = (),
    prior_deviation: float | None = None,
    consistent: str | None = None,
    repair: bool = False,
) -> Identification:
    """Fit a force model to recordings, and say how much of it they support.

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
        Processes that work on the regressors; the result is the same to the bit.
    on_dark : str
        Where no force of the training data depends on a combination of parameters: ``"refuse"``, or
        ``"truncate"``: fit the others, and keep the robot file's values there. Parameters that have
        a part in it are then ``assumed``, and their intervals infinite.
    references : sequence of JointMotion, optional
        For ``"iv"``, one a training recording: the motion that was commanded, or simulated.
    prior_deviation : float, optional
        For ``"bayes"``: standard deviation of the robot file's parameters, relative to their sizes
        (``cad_prior``); 0.3 by default.
    consistent : str, optional
        Fit bodies that can exist, too: the regularisation of ``consistent_fit``, ``"entropic"``,
        ``"euclidean"`` or ``"riemannian"``.
    repair : bool
        Whether bodies of the robot file that cannot exist are mended for that.

    Raises
    ------
    RankError
        Naming the combinations that the data do not show, and the motion that would show them.

    Warns
    -----
    ExcitationWarning
        Of combinations that the data do not show, where the estimator has other ways to them, and
        of those that they tell worse than the robot file.
    """
    if on_dark not in ON_DARK:
        raise OptionError.unknown("answer to what data do not show", on_dark, ON_DARK)
    require_references(estimator, training, references)
    samples = gathered_samples(force_model, training, n_jobs, references)
    data = samples, gathered_samples(force_model, validation, n_jobs)
    support, fill = data_support(force_model, training, samples), on_dark == "truncate"
    joints = support.excited.joint_sizes if fill and support.dark else None
    chosen = estimator_for(force_model, estimator, prior_deviation, joints)
    _require_shown(support, chosen, fill)
    if friction:
        first = gathered_samples(force_model, friction, n_jobs)
        _require_shown(data_support(force_model, friction, first), chosen)
        support = data_support(force_model, training, samples.select(force_model.body_columns))
        _require_shown(support, chosen)
        known = [force_model.parameters.labels[j] for j in force_model.joint_columns]
        fitted = fit_in_steps(first, samples, known, chosen)
    else:
        fitted = _fitted(force_model, samples, chosen, support, fill)
    _warn(support)
    reduction = reduce_shown(force_model, data, chosen)
    bodies = None
    if consistent is not None:
        bodies = fit_consistent(force_model, samples.problem, fitted, consistent, repair)
    return Identification(
        force_model,
        tuple(training),
        tuple(validation),
        data,
        fitted,
        reduction,
        _candidates(force_model, data, chosen, (fitted, len(support.dark)), reduction),
        support,
        bodies,
    )


def _candidates(
    force_model: ForceModel,
    data: tuple[FitSamples, FitSamples],
    estimator: Estimator,
    fitted: tuple[FitResult, int],
    reduction: Reduction,
) -> tuple[Candidate, Candidate, Candidate]:
    """Judged by the data; of all parameters so many combinations are not from the data."""
    start, spread = fit_baseline(force_model, data[0], estimator)
    (whole, dark), supported = fitted, reduction.supported
    shown = len(start) - dark
    joints, values, covariance = len(force_model.joint_columns), whole.values, whole.covariance
    return (
        judge("robot file", joints, start, spread, data, start),
        judge("all parameters", shown, values, covariance, data, start),
        judge(
            "supported parameters", supported, reduction.values, reduction.covariance, data, start
        ),
    )


def _require_shown(support: DataSupport, estimator: Estimator, fill: bool = False) -> None:
    """Refuse dark combinations, unless they are to be filled in, or a prior knows of them."""
    if support.dark and not fill and not isinstance(estimator, BayesianRidge):
        raise RankError(support.refusal)


def _fitted(
    force_model: ForceModel,
    samples: FitSamples,
    estimator: Estimator,
    support: DataSupport,
    fill: bool,
) -> FitResult:
    if not support.dark:
        return fit(samples, estimator)
    if not isinstance(estimator, BayesianRidge):
        fitted = fit_shown(force_model, samples, estimator)
        warn_of_insignificant(fitted)
        return fitted
    try:
        fitted = fit(samples, estimator)
    except RankError as error:
        raise RankError(support.refusal) from error
    return replace(fitted, assumed=support.assumed) if fill else fitted


def _warn(support: DataSupport) -> None:
    said = [support.darkness] if support.dark else []
    said += [support.doubt] if support.doubtful else []
    for sentence in said:
        warnings.warn(sentence, ExcitationWarning, stacklevel=3)
