"""Several values for the same parameters, each beside the one that predicts new data best."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import DataError
from loopid.identification.correlation import Autoregression, burg_covariances, run_lengths
from loopid.identification.problem import FitSamples

# Standard errors of a difference that make it clear.
CLEARLY = 2.0
# Relative difference of mean squared errors that is worth no parameter.
NO_CONSEQUENCE = 0.02


class PredictionError(NamedTuple):
    """How well values predict data that were not fitted, beside others.

    Attributes
    ----------
    mean, standard_error : float
        Mean square of scaled residuals over all actuators.
    excess, excess_error : float
        Of the mean over that of the best values, and its standard error; 0 for the best.
    as_good : bool
        Whether the mean is not clearly above the least: within one standard error of it
        [Breiman1984] and two of the difference, or within 2 %.
    """

    mean: float
    standard_error: float
    excess: float
    excess_error: float
    as_good: bool


def prediction_errors(
    validation: FitSamples, candidates: Sequence[FloatArray], scale: FloatArray
) -> list[PredictionError]:
    """Errors of several values (n,) on the same data, each beside the best of them.

    Parameters
    ----------
    scale : FloatArray
        (dof,), that residuals are multiplied by; 0 leaves an actuator out.
    """
    means = [_mean(validation, _squares(validation, values, scale), scale) for values in candidates]
    best = int(np.argmin([mean for mean, _ in means]))
    least, found = _squares(validation, candidates[best], scale), list[PredictionError]()
    for k, (values, (mean, error)) in enumerate(zip(candidates, means, strict=True)):
        # Of the differences at each time: what both share, as a disturbance that neither explains,
        # does not count as uncertainty.
        excess, excess_error = 0.0, 0.0
        if k != best:
            more = _squares(validation, values, scale) - least
            excess, excess_error = _mean(validation, more, scale)
        # One standard error of the best is wide where a disturbance that none explains makes all
        # of them uncertain; two of the difference are not.
        uncertainty = min(means[best][1], CLEARLY * excess_error)
        as_good = excess <= max(uncertainty, NO_CONSEQUENCE * means[best][0])
        found.append(PredictionError(mean, error, excess, excess_error, as_good))
    return found


def _squares(samples: FitSamples, values: FloatArray, scale: FloatArray) -> FloatArray:
    """Squared scaled residuals of all actuators together (N,); a scale of 0 leaves one out."""
    squares = (samples.residual(values) * scale) ** 2 * (samples.used & (scale > 0))
    return np.asarray(squares.sum(axis=1), dtype=np.float64)


def _mean(samples: FitSamples, series: FloatArray, scale: FloatArray) -> tuple[float, float]:
    """Mean of a series (N,) by forces that count, and its standard error.

    The series is an autoregressive process: neither times nor actuators count as independent.
    """
    counts = (samples.used & (scale > 0)).sum(axis=1)
    total = int(counts.sum())
    if not total:
        raise DataError("there is no validation sample of an actuator that was fitted")
    mean, present = float(series.sum()) / total, counts > 0
    runs = run_lengths(present, samples.pieces)
    model = Autoregression.of_covariances(burg_covariances(series - mean * counts, runs))
    return mean, float(np.sqrt(model.sum_variance(present, samples.pieces))) / total
