"""The fits of an identification, with the robot file's values where data show nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.experiment.cad_prior import PRIOR_DEVIATION, cad_prior
from loopid.experiment.excited import Excited
from loopid.experiment.force_model import ForceModel
from loopid.experiment.supported_fit import fit_supported, prior_of
from loopid.experiment.weak_directions import held_parameters
from loopid.identification import (
    BayesianRidge,
    Estimator,
    FitResult,
    FitSamples,
    Reduction,
    ReductionStep,
    WeightedLeastSquares,
    chosen_estimator,
    eliminate,
    quiet_fit,
)


def estimator_for(
    force_model: ForceModel,
    estimator: str | Estimator,
    prior_deviation: float | None = None,
    joint_deviations: FloatArray | None = None,
) -> Estimator:
    """An estimator by its name; ``"bayes"`` has the robot file as its prior.

    Parameters
    ----------
    prior_deviation : float, optional
        Of the robot file, as of ``cad_prior``.
    joint_deviations : FloatArray, optional
        (k,), of joint terms about zero; by default nothing is known of them.

    Raises
    ------
    OptionError
        When there is no such estimator, or it has no prior whose deviation was given.
    """
    if estimator == BayesianRidge.name:
        relative = PRIOR_DEVIATION if prior_deviation is None else prior_deviation
        prior = cad_prior(force_model, relative, joint_deviations=joint_deviations)
        return BayesianRidge(prior)
    if prior_deviation is not None:
        raise OptionError(
            f"a deviation of the robot file is for the estimator {BayesianRidge.name!r}, which has "
            f"it as its prior, not for {estimator!r}"
        )
    return chosen_estimator(estimator)


def fit_shown(force_model: ForceModel, samples: FitSamples, estimator: Estimator) -> FitResult:
    """Fit what samples show of their parameters; prior values stand for the rest."""
    if isinstance(estimator, BayesianRidge):
        return quiet_fit(samples, estimator)
    excited = Excited.of(force_model, samples.problem)
    if excited.rank == len(samples.parameters):
        return quiet_fit(samples, estimator)
    return fit_supported(samples, prior_of(force_model, samples), excited, estimator)


def fit_baseline(
    force_model: ForceModel, samples: FitSamples, estimator: Estimator
) -> tuple[FloatArray, FloatArray]:
    """Values (n,) and covariance (n, n) with the bodies of the robot file, joint terms fitted."""
    values, joints = force_model.prior.copy(), force_model.joint_columns
    covariance = np.zeros((len(values), len(values)))
    if len(joints):
        # A joint term may lead a combination with bodies, of which the robot file knows a part.
        values[joints] = 0.0
        left = samples.less(samples.predicted(values)).select(joints)
        terms = fit_shown(force_model, left, estimator)
        values[joints] = terms.values
        covariance[np.ix_(joints, joints)] = terms.covariance
    return values, covariance


def reduce_shown(
    force_model: ForceModel,
    data: tuple[FitSamples, FitSamples],
    estimator: Estimator,
) -> Reduction:
    """Eliminate what training data do not support; what they do not show goes first.

    What data support is not for a prior to say: weighted least squares stands in for Bayes.
    """
    prior = force_model.prior
    if isinstance(estimator, BayesianRidge):
        estimator = WeightedLeastSquares()
    held = held_parameters(Excited.of(force_model, data[0].problem)).tolist()
    if not held:
        return eliminate(*data, estimator, reference=prior)
    shown = [j for j in range(len(prior)) if j not in held]
    known = np.where(np.isin(np.arange(len(prior)), held), prior, 0.0)
    left = [part.less(part.predicted(known)).select(shown) for part in data]
    found = eliminate(left[0], left[1], estimator, reference=prior[shown])
    return _embedded(found, data[0], prior, shown)


def _embedded(
    found: Reduction, samples: FitSamples, prior: FloatArray, shown: Sequence[int]
) -> Reduction:
    """The same reduction, of all parameters."""

    def embedded(step: ReductionStep) -> ReductionStep:
        values = prior.copy()
        values[list(shown)] = step.values
        return replace(step, values=values)

    steps = tuple(embedded(step) for step in found.steps)
    chosen = steps[found.steps.index(found.chosen)]
    return Reduction(samples.parameters, prior, steps, chosen, found.result)
