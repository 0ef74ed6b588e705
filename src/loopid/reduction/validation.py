"""Mean squared errors over a log, and how well the log tells them."""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import DataError
from loopid.identification import FitSamples
from loopid.identification.autoregression import Autoregression
from loopid.identification.burg import burg_covariances, run_lengths
from loopid.scratch import mapped_rows, row_blocks


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
    own, other = (_squares(samples, phi, scale) for phi in (values, best))
    series = mapped_rows(lambda rows: own[rows] - other[rows], len(samples))
    return _mean(samples, series, scale)


def _squares(samples: FitSamples, values: FloatArray, scale: FloatArray) -> FloatArray:
    """Squared scaled residuals of all actuators together (N,)."""
    residual, counted = samples.residual(values), scale > 0

    def squares(rows: slice) -> FloatArray:
        present = samples.used[rows] & counted
        return np.asarray(((residual[rows] * scale) ** 2 * present).sum(axis=1))

    return mapped_rows(squares, len(samples))


def _mean(samples: FitSamples, series: FloatArray, scale: FloatArray) -> tuple[float, float]:
    """Mean of a series (N,) by forces that count, and its standard error."""
    counted = scale > 0
    counts = mapped_rows(lambda rows: (samples.used[rows] & counted).sum(axis=1), len(samples))
    total, sum_ = (
        float(sum(part[rows].sum() for rows in row_blocks(len(samples))))
        for part in (counts, series)
    )
    if not total:
        raise DataError("there is no validation sample of an actuator that was fitted")
    mean = sum_ / total
    errors = mapped_rows(lambda rows: series[rows] - mean * counts[rows], len(samples))
    present = mapped_rows(lambda rows: counts[rows] > 0, len(samples))
    return mean, sum_deviation(samples, errors, present) / total


def sum_deviation(samples: FitSamples, series: FloatArray, present: BoolArray) -> float:
    """Standard deviation of the sum of a series (N,) where it is present (N,)."""
    runs = run_lengths(present, samples.pieces)
    model = Autoregression.of_covariances(burg_covariances(series, runs))
    return float(np.sqrt(model.sum_variance(present, samples.pieces)))
