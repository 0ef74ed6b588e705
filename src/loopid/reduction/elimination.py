"""Backward elimination: the parameters that data support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, finite
from loopid.errors import DataError, OptionError
from loopid.identification import Estimator, FitResult, FitSamples
from loopid.identification.fitting import quiet_fit, working_fit
from loopid.identification.quality import fit_quality
from loopid.identification.result import relative_deviation
from loopid.reduction.result import Reduction, ReductionStep
from loopid.reduction.subset_fit import SubsetFits
from loopid.reduction.validation import excess_error, mean_squared_error

# Standard errors of a difference that make it clear.
CLEARLY = 2.0
# Relative difference of mean squared errors that nobody would carry a parameter for.
NO_CONSEQUENCE = 0.02


@checked
def eliminate(
    training: FitSamples,
    validation: FitSamples,
    estimator: str | Estimator = "wls",
    reference: FloatArray | None = None,
    keep: Sequence[str] = (),
) -> Reduction:
    """Drop the least certain parameters one by one, and keep as few as predict as well.

    At each step the parameter with the largest relative standard deviation goes back to its
    reference, and the others are fitted again. Of all steps, the one with the fewest parameters is
    chosen whose validation error is not clearly above the least: within one standard error of it
    [Breiman1984] and two of the difference, or within 2 %.

    Parameters
    ----------
    training, validation : FitSamples
        Different data, of the same parameters and actuators.
    estimator : str or Estimator
        As of ``fit``. Weights and error model are those of the full model at every step.
    reference : FloatArray, optional
        (n,), values of dropped parameters, such as the robot file's; by default zero.
    keep : sequence of str
        Names that are never dropped.

    Raises
    ------
    DataError
        When the data do not belong together, or the full model fits without error.
    RankError
        When the training data do not tell all parameters apart.
    """
    names = training.parameters
    if (validation.parameters, validation.actuators) != (names, training.actuators):
        raise DataError("validation data must have the parameters and actuators of the training")
    start = _checked_reference(reference, len(names))
    kept = _checked_keep(keep, names.labels)
    working = working_fit(training, estimator)
    full, fits = working.result, SubsetFits(working, start)
    steps = _steps((training, validation), full, fits, kept)
    best = min(steps, key=lambda step: step.validation_error)
    steps = [_compared(step, best, validation, _error_scale(full)) for step in steps]
    chosen = [step for step in steps if step.excess <= _allowed(step, best)][-1]
    result = _fit_of(training, chosen, start, estimator)
    return Reduction(names, start, tuple(steps), chosen, result)


def _checked_reference(reference: FloatArray | None, width: int) -> FloatArray:
    start = np.zeros(width) if reference is None else finite(reference, "reference")
    if start.shape != (width,):
        raise DataError(f"reference must have shape ({width},), not {start.shape}")
    return start


def _checked_keep(keep: Sequence[str], labels: tuple[str, ...]) -> set[int]:
    for name in keep:
        if name not in labels:
            raise OptionError.unknown("parameter to keep", name, labels)
    return {labels.index(name) for name in keep}


def _steps(
    data: tuple[FitSamples, FitSamples], full: FitResult, fits: SubsetFits, kept: set[int]
) -> list[ReductionStep]:
    """Steps from all parameters down to those to keep, or to one."""
    scale = _error_scale(full)
    labels, columns = full.parameters.labels, list(range(len(full.values)))
    dropped, relative, steps = None, np.nan, list[ReductionStep]()
    while True:
        values, errors = fits.fit(columns)
        left = tuple(labels[j] for j in columns)
        steps.append(_judged((left, dropped, relative), values, data, scale))
        free = [k for k, j in enumerate(columns) if j not in kept]
        if not free or len(columns) == 1:
            return steps
        deviations = relative_deviation(errors, (values - fits.reference)[columns])
        worst = max(free, key=lambda k: deviations[k])
        dropped, relative = labels[columns[worst]], float(deviations[worst])
        columns.pop(worst)


def _error_scale(full: FitResult) -> FloatArray:
    """What turns residuals (dof,) into units of the full model's errors; 0 without samples."""
    assert full.noise is not None
    deviation, present = full.noise.deviation, full.noise.samples > 0
    if not (deviation[present] > 0).all():
        raise DataError("the full model fits without error: there is nothing to reduce by")
    scale = np.zeros(len(deviation))
    scale[present] = 1.0 / deviation[present]
    return scale


def _judged(
    about: tuple[tuple[str, ...], str | None, float],
    values: FloatArray,
    data: tuple[FitSamples, FitSamples],
    scale: FloatArray,
) -> ReductionStep:
    training, validation = data
    error, spread = mean_squared_error(validation, values, scale)
    squares = training.problem.residual_squares(values) * scale**2
    return ReductionStep(
        *about,
        values=values,
        training_rms=fit_quality(training.problem, values).residual_rms,
        validation_rms=fit_quality(validation.problem, values).residual_rms,
        training_error=float(squares.sum() / training.problem.rows),
        validation_error=error,
        standard_error=spread,
    )


def _allowed(step: ReductionStep, best: ReductionStep) -> float:
    """How much worse than the best a step may be.

    One standard error of the best [Breiman1984], which is wide where a disturbance that no step
    explains makes all of them doubtful; so also two of the difference, which is not. Less than a
    difference of no consequence is never asked for.
    """
    doubt = min(best.standard_error, CLEARLY * step.excess_error)
    return max(doubt, NO_CONSEQUENCE * best.validation_error)


def _compared(
    step: ReductionStep, best: ReductionStep, validation: FitSamples, scale: FloatArray
) -> ReductionStep:
    if step is best:
        return step
    excess, error = excess_error(validation, step.values, best.values, scale)
    return replace(step, excess=excess, excess_error=error)


def _fit_of(
    training: FitSamples, step: ReductionStep, reference: FloatArray, estimator: str | Estimator
) -> FitResult:
    labels = training.parameters.labels
    columns = [labels.index(label) for label in step.labels]
    known = reference.copy()
    known[columns] = 0.0
    return quiet_fit(training.less(training.predicted(known)).select(columns), estimator)
