"""Candidates: values judged on data that they were not fitted to."""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked, shaped
from loopid.identification.correlation import means_of_series
from loopid.identification.problem import FitSamples
from loopid.identification.quality import Quality
from loopid.identification.result import Fit
from loopid.numbers import FIT_ROUND_OFF
from loopid.records import record

# Segments of time whose errors count as independent of each other: few, hence long, as errors
# are autocorrelated over seconds.
BATCHES = 8
MUCH_WORSE = 2.0  # ratio of errors of a motor
WORSE = 1.05  # ratio of errors: less is not worth bodies whose intervals nobody knows
NO_DIFFERENCE = 1e-9  # of mean squared errors: smaller ones are round-off


@record
class Candidate:
    """Values for all parameters of a force model, beside those of a baseline.

    Attributes
    ----------
    name : str
    fit : Fit
        All n values, with their uncertainty.
    validation : Quality
        On data that were not fitted.
    predicted : FloatArray
        (N, dof) forces on these data, by fits that have not seen them.
    rms_errors : tuple of FloatArray
        Standard errors (dof,) of the rms on training and on validation data, in N or N m.
    error_ratio : tuple of float
        Mean squared validation error over that of the baseline, the geometric mean over the motors;
        and its standard error.
    motor_ratios : FloatArray
        (dof,), that of each motor; NaN without samples.
    regions : FloatArray or None
        (dof,), root mean square errors on regions of states that were left out; None where these
        were not.
    """

    name: str
    fit: Fit
    validation: Quality
    predicted: FloatArray
    rms_errors: tuple[FloatArray, FloatArray]
    error_ratio: tuple[float, float]
    motor_ratios: FloatArray
    regions: FloatArray | None = None

    @property
    def fitted(self) -> int:
        """Number of parameters that the data alone determine; the others rest on assumptions."""
        return len(self.fit.values) - len(self.fit.assumed)

    @property
    def beats_baseline(self) -> bool:
        """Whether the validation error is smaller by more than two standard errors."""
        ratio, error = self.error_ratio
        return 1.0 - ratio > 2 * error + NO_DIFFERENCE

    @property
    def loses_to_baseline(self) -> bool:
        """Whether the validation error is clearly larger than the baseline's.

        By a twentieth and by more than two standard errors. Or it is larger, and more than twice
        that of the baseline in some motor.
        """
        ratio, error = self.error_ratio
        if float(np.nanmax(self.motor_ratios, initial=0.0)) > MUCH_WORSE**2:
            return ratio > 1.0 + NO_DIFFERENCE
        return ratio > max(1.0 + 2 * error, WORSE**2)


@checked
def judge(
    fit: Fit,
    data: FitSamples,
    new: FitSamples,
    *,
    name: str,
    against: Fit,
    predicted: tuple[FloatArray, FloatArray] | None = None,
) -> Candidate:
    """Judge a fit of data on new data, beside a baseline.

    Parameters
    ----------
    fit : Fit
    data, new : FitSamples
        Of all parameters: what was fitted, and what was not.
    name : str
        Of the candidate.
    against : Fit
        The baseline.
    predicted : tuple of FloatArray, optional
        Forces (N, dof) on the new data, of the fit and of the baseline, where those were not
        predicted by these values but by fits that have not seen them.

    Returns
    -------
    Candidate
        Errors on both, and their ratio to the baseline's.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> model = loopid.force_model(robot, "full", "Fc,Fv")
    >>> data = loopid.identification.samples_of(model, [run])
    >>> file = loopid.identification.fit_joint_terms(model, data)
    >>> fit = loopid.identification.fit(data)
    >>> judged = loopid.identification.judge(fit, data, data, name="all", against=file)
    >>> judged.loses_to_baseline
    False
    """
    if predicted is None:
        predicted = new.predicted(fit.values), new.predicted(against.values)
    own, other = (shaped(each, "predicted", *new.force.shape) for each in predicted)
    rms_errors = _rms_errors(data, data.predicted(fit.values)), _rms_errors(new, own)
    return Candidate(
        *(name, fit, quality_of(new, own), own, rms_errors), *error_ratio(new, own, other)
    )


def quality_of(samples: FitSamples, predicted: FloatArray) -> Quality:
    """Errors of predicted forces (N, dof) where these are used."""
    squares = (np.where(samples.used, samples.force - predicted, 0.0) ** 2).sum(axis=0)
    return Quality.of(samples.problem, squares)


def _rms_errors(samples: FitSamples, predicted: FloatArray) -> FloatArray:
    """Standard errors (dof,) of the rms of errors of predicted forces (N, dof); NaN for none."""
    errors, residual = np.full(len(samples.actuators), np.nan), samples.force - predicted
    for k in np.flatnonzero(samples.problem.samples):
        used = samples.used[:, k]
        squares = np.where(used, residual[:, k], 0.0) ** 2
        if squares.any():
            mean, error = means_of_series(squares[None], used, samples.pieces)
            errors[k] = error[0] / (2 * np.sqrt(mean[0]))
    return errors


def error_ratio(
    samples: FitSamples, own: FloatArray, other: FloatArray, parts: IntArray | None = None
) -> tuple[tuple[float, float], FloatArray]:
    """Mean squared error of predicted forces (N, dof) over that of other ones.

    The geometric mean over the motors with samples, with its standard error, and that of each motor
    (dof,), NaN without samples. The error is by the jackknife over parts [Efron1982] whose errors
    are alike, with numbers (N,), by default equal parts of the time. It is NaN where a motor has
    samples in one alone.
    """
    problem = samples.problem
    if parts is None:
        parts = np.arange(len(samples)) * BATCHES // len(samples)
    least = np.maximum(samples.least_errors, FIT_ROUND_OFF * problem.force_rms) ** 2
    names = np.unique(parts)

    def sums(predicted: FloatArray) -> FloatArray:
        """Of squares (B, dof), which are never less than round-off."""
        squares = np.where(samples.used, (samples.force - predicted) ** 2 + least, 0.0)
        return np.array([squares[parts == name].sum(axis=0) for name in names])

    A, B = sums(own), sums(other)
    with np.errstate(divide="ignore", invalid="ignore"):
        motors = np.log(A.sum(axis=0)) - np.log(B.sum(axis=0))
        without = np.log(A.sum(axis=0) - A) - np.log(B.sum(axis=0) - B)
    present, count = np.isfinite(motors), len(names)
    ratio, without = np.nan, without[:, present]
    if present.any():
        ratio = float(np.exp(motors[present].mean()))
    if count < 2 or not np.isfinite(without).all():
        return (ratio, np.nan), np.exp(motors)
    spread = np.std(without.mean(axis=1)) * np.sqrt(count - 1)
    return (ratio, ratio * float(spread)), np.exp(motors)
