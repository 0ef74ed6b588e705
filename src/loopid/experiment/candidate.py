"""Ways of predicting forces, judged on data that none of them has seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, finite
from loopid.errors import DataError
from loopid.identification import FitSamples, Quality, fit_quality
from loopid.scratch import row_blocks

# Stretches of time whose errors count as independent of each other: few, hence long, as errors
# follow one another for seconds.
BATCHES = 8
INTERVAL = 1.96  # standard deviations of a normal 95 % interval
# Differences below this are round-off.
NO_DIFFERENCE = 1e-9


@dataclass(frozen=True)
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

    @property
    def beats_baseline(self) -> bool:
        """Whether the validation error is smaller by more than two standard errors."""
        ratio, error = self.error_ratio
        return 1.0 - ratio > 2 * error + NO_DIFFERENCE


def judge(
    name: str,
    fitted: int,
    values: FloatArray,
    covariance: FloatArray,
    data: tuple[FitSamples, FitSamples],
    baseline: FloatArray,
) -> Candidate:
    """Measure a candidate on training and validation data, beside baseline values (n,)."""
    training, validation = data
    return Candidate(
        name=name,
        fitted=fitted,
        values=values,
        covariance=covariance,
        training=fit_quality(training.problem, values),
        validation=fit_quality(validation.problem, values),
        rms_errors=(_rms_errors(training, values), _rms_errors(validation, values)),
        error_ratio=_error_ratio(validation, values, baseline),
    )


def _rms_errors(samples: FitSamples, values: FloatArray) -> FloatArray:
    """Standard errors (dof,) of the rms of residuals, to first order; NaN without samples."""
    residual, errors = samples.residual(values), np.full(len(samples.actuators), np.nan)
    counts = samples.problem.samples
    for k in np.flatnonzero(counts):
        squares = (
            residual[rows, k][samples.used[rows, k]] ** 2 for rows in row_blocks(len(samples))
        )
        means, mean = _batch_means(squares, int(counts[k]))
        if mean > 0:
            errors[k] = _mean_error(means) / (2 * np.sqrt(mean))
    return errors


def _batch_means(series: Iterator[FloatArray], count: int) -> tuple[FloatArray, float]:
    """Means of the batches of a series of so many numbers in blocks, and of all of it."""
    ends = np.cumsum([len(batch) for batch in np.array_split(range(count), min(BATCHES, count))])
    sums, done = np.zeros(len(ends)), 0
    for block in series:
        batch = np.searchsorted(ends, np.arange(done, done + len(block)), "right")
        sums += np.bincount(batch, block, minlength=len(ends))
        done += len(block)
    return sums / np.diff(ends, prepend=0), float(sums.sum() / count)


def _mean_error(means: FloatArray) -> float:
    """Standard error of a mean from those of its batches; NaN for one."""
    return float(np.std(means, ddof=1) / np.sqrt(len(means))) if len(means) > 1 else np.nan


def _error_ratio(
    samples: FitSamples, values: FloatArray, baseline: FloatArray
) -> tuple[float, float]:
    """Ratio of mean squared errors, and its standard error to first order, from paired squares."""
    own, other = (
        _batch_means(_weighted_squares(samples, phi, baseline), len(samples))
        for phi in (values, baseline)
    )
    ratio = own[1] / other[1]
    return ratio, _mean_error(own[0] - ratio * other[0]) / other[1]


def _weighted_squares(
    samples: FitSamples, values: FloatArray, baseline: FloatArray
) -> Iterator[FloatArray]:
    """Blocks of squared errors (N,), each actuator in units of its baseline error."""
    rms = fit_quality(samples.problem, baseline).residual_rms
    scale, present = np.maximum(rms, samples.least_errors), samples.problem.samples > 0
    for rows in row_blocks(len(samples)):
        residual = samples.force[rows] - samples.regressor[rows] @ values
        residual = np.where(samples.used[rows], residual, 0.0)[:, present]
        yield np.asarray(((residual / scale[present]) ** 2).sum(axis=1))


@checked
def prediction_reach(regressor: FloatArray, covariance: FloatArray) -> FloatArray:
    """Half the width (N, dof) of the 95 % intervals of predicted forces.

    As ``prediction_error``.
    """
    return INTERVAL * prediction_error(regressor, covariance)


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
