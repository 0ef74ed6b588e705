"""Mean squared errors over a log, and how well the log tells them."""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import DataError
from loopid.identification import FitSamples
from loopid.identification.autoregression import Autoregression
from loopid.identification.burg import burg_covariances, run_lengths


def mean_squared_error(
    samples: FitSamples, values: FloatArray, scale: FloatArray
) -> tuple[float, float]:
    """Mean square of scaled residuals over samples and actuators, and its standard error.

    The squares of all actuators at one time are one number, and follow one another as an
    autoregressive process; so no independence is assumed, over time or between actuators.

    Parameters
    ----------
    values : FloatArray
        (n,).
    scale : FloatArray
        (dof,), times each residual; 0 leaves an actuator out.
    """
    return _mean(samples, _squares(samples, values, scale), scale)


def excess_error(
    samples: FitSamples, values: FloatArray, best: FloatArray, scale: FloatArray
) -> tuple[float, float]:
    """By how much the mean squared error exceeds that of the best values, and its standard error.

    Of the differences at each time: what both share, as a disturbance that neither explains, does
    not count as doubt. Parameters as of ``mean_squared_error``.
    """
    series = _squares(samples, values, scale) - _squares(samples, best, scale)
    return _mean(samples, series, scale)


def _squares(samples: FitSamples, values: FloatArray, scale: FloatArray) -> FloatArray:
    """Squared scaled residuals of all actuators together (N,)."""
    counted = samples.used & (scale > 0)
    squares = (samples.residual(values) * scale) ** 2 * counted
    return np.asarray(squares.sum(axis=1), dtype=np.float64)


def _mean(samples: FitSamples, series: FloatArray, scale: FloatArray) -> tuple[float, float]:
    """Mean of a series (N,) by forces that count, and its standard error."""
    counts = (samples.used & (scale > 0)).sum(axis=1)
    total = float(counts.sum())
    if not total:
        raise DataError("there is no validation sample of an actuator that was fitted")
    mean = float(series.sum()) / total
    return mean, sum_deviation(samples, series - mean * counts, counts > 0) / total


def sum_deviation(samples: FitSamples, series: FloatArray, present: BoolArray) -> float:
    """Standard deviation of the sum of a series (N,) where it is present (N,)."""
    runs = run_lengths(present, samples.pieces)
    model = Autoregression.of_covariances(burg_covariances(series, runs))
    ones = present.astype(np.float64)[:, None]
    parts = [ones[piece] for piece in samples.pieces]
    return float(np.sqrt(sum(np.vdot(part, model.covariance_times(part)) for part in parts)))
