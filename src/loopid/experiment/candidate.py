"""Ways of predicting forces, judged on data that none of them has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, finite
from loopid.errors import DataError
from loopid.identification import FitSamples, Quality, fit_quality
from loopid.scratch import row_blocks

# Stretches of time whose errors count as independent of each other: few, hence long, as errors
# are autocorrelated over seconds.
BATCHES = 8
INTERVAL = 1.96  # standard deviations of a normal 95 % interval
# Differences below this are round-off.
NO_DIFFERENCE = 1e-9


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


def judged(
    name: str,
    fitted: tuple[int, FloatArray, FloatArray],
    data: tuple[FitSamples, FitSamples],
    baseline: FloatArray,
) -> Candidate:
    """Judge a number of fitted parameters, values (n,) and covariance beside baseline values (n,).

    Parameters
    ----------
    data : tuple of FitSamples
        For training and for validation.
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
            errors[k] = _mean_error(_batch_means(squares)) / (2 * np.sqrt(squares.mean()))
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
    return ratio, _mean_error(_batch_means(own - ratio * other)) / float(other.mean())


def _batch_means(series: FloatArray) -> FloatArray:
    batches = np.array_split(series, min(BATCHES, len(series)))
    return np.array([batch.mean() for batch in batches])


def _mean_error(means: FloatArray) -> float:
    """Standard error of a mean from those of its batches; NaN for one."""
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
    """Half the width (N, dof) of the 95 % intervals of predicted forces.

    As ``prediction_error``.
    """
    return INTERVAL * prediction_error(regressor, covariance)
