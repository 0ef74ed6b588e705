"""A fit of what data show, with the robot file's values for what they do not.

φ = φ₀ + B z with B the changes that the data show: z is fitted, and of all the parameters that fit
as well these are nearest to the robot file, in its sizes. It is the limit of Bayes' estimate for a
prior that is ever less certain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import DataError, RankError
from loopid.experiment.excited import Excited
from loopid.experiment.force_model import ForceModel
from loopid.identification import (
    Estimator,
    FitResult,
    FitSamples,
    OrdinaryLeastSquares,
    fit_quality,
    quiet_fit,
)
from loopid.parameters import ParameterSet
from loopid.scratch import mapped_rows


def prior_of(force_model: ForceModel, samples: FitSamples) -> FloatArray:
    """The robot file's values (n,) of the parameters of samples."""
    labels = force_model.parameters.labels
    return force_model.prior[[labels.index(name) for name in samples.parameters.labels]]


def lit_samples(samples: FitSamples, prior: FloatArray, excited: Excited) -> FitSamples:
    """The same samples, of the changes from the robot file that they show."""
    B = excited.lit
    W = mapped_rows(lambda rows: samples.regressor[rows] @ B, len(samples))
    Z = samples.instruments
    if Z is not None:
        given = Z
        Z = mapped_rows(lambda rows: given[rows] @ B, len(samples))
    names = ParameterSet.from_labels([f"combination.{k + 1}" for k in range(B.shape[1])])
    left = samples.less(samples.predicted(prior))
    return replace(left, parameters=names, regressor=W, instruments=Z)


def fit_supported(
    samples: FitSamples, prior: FloatArray, excited: Excited, estimator: str | Estimator = "wls"
) -> FitResult:
    """Fit what the data show; prior values (n,) stand where they show nothing.

    Returns
    -------
    FitResult
        Of all parameters. In directions that are dark the covariance is that of the robot file,
        one size; parameters that have a part there are ``assumed``.
    """
    found = quiet_fit(lit_samples(samples, prior, excited), estimator)
    values = prior + excited.lit @ found.values
    dark = excited.dark
    covariance = excited.lit @ found.covariance @ excited.lit.T + dark @ dark.T
    return replace(
        found,
        parameters=samples.parameters,
        values=values,
        covariance=(covariance + covariance.T) / 2,
        quality=fit_quality(samples.problem, values),
        assumed=excited.assumed(samples.parameters),
    )


def uncertainties(
    force_model: ForceModel, samples: FitSamples, excited: Excited
) -> tuple[FloatArray, FloatArray]:
    """Standard errors (rank,) in sizes, ascending, and their directions (rank, rank).

    They hold for errors that follow one another; NaN where there are not more rows than directions.
    """
    if not excited.rank:
        return np.empty(0), np.empty((0, 0))
    lit = lit_samples(samples, prior_of(force_model, samples), excited)
    for estimator in ("wls", OrdinaryLeastSquares()):
        try:
            found = quiet_fit(lit, estimator)
        except (DataError, RankError):
            continue
        squares, turns = np.linalg.eigh(found.covariance)
        return np.sqrt(np.maximum(squares, 0.0)), turns
    return np.full(excited.rank, np.nan), np.eye(excited.rank)
