"""Which parameters predictions need: backward elimination, and what leaving some out does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from loopid.arguments import FloatArray, IntArray, checked, shaped, variances
from loopid.errors import DataError, first_of
from loopid.identification.candidate import Candidate, judge
from loopid.identification.correlation import means_of_series
from loopid.identification.estimates import relative_deviation
from loopid.identification.estimator import Estimator, WorkingFit
from loopid.identification.fitting import quiet_fit, working_fit
from loopid.identification.information import Excitation
from loopid.identification.outcome import Outcome
from loopid.identification.problem import FitSamples
from loopid.identification.result import Fit, of_all
from loopid.parameters import ParameterSet, html_table
from loopid.records import record

# Standard errors of a difference that make it clear, and the relative difference of mean squared
# errors that is worth no parameter.
CLEARLY, NO_CONSEQUENCE = 2.0, 0.02
NAMED = 12  # parameters in a ``repr``


@record
class ReductionStep:
    """A fit of some of the parameters, the others at their reference.

    Errors are mean squares in units of the error variance of the full model, each actuator's own.

    Attributes
    ----------
    labels : tuple of str
        Names that are fitted.
    dropped : str or None
        Name that was dropped on the way here.
    relative_std : float
        Of the dropped one, in % of its distance from its reference, in the step before; NaN where
        none was dropped.
    values : FloatArray
        (n,).
    training_error : float
        Over all actuators.
    error : PredictionError
        On the validation data, beside the best step.
    """

    labels: tuple[str, ...]
    dropped: str | None
    relative_std: float
    values: FloatArray
    training_error: float
    error: PredictionError


@record(checked="outside")
class Reduction:
    """The parameters that are worth fitting.

    Attributes
    ----------
    parameters : ParameterSet
        All n.
    reference : FloatArray
        (n,), values of parameters that are dropped.
    steps : tuple of ReductionStep
        From all parameters to the fewest.
    chosen : ReductionStep
        With the fewest parameters of those whose validation error is not clearly above the least.
    result : Fit
        Of the supported parameters; forces of the others are subtracted before.

    Examples
    --------
    >>> import loopid
    >>> found = loopid.identify(loopid.load("five_bar"), "urdf/logs/five_bar.csv")
    >>> reduction = loopid.identification.eliminate(found)
    >>> len(reduction.chosen.labels) < len(reduction.parameters)
    True
    """

    parameters: ParameterSet
    reference: FloatArray
    steps: tuple[ReductionStep, ...]
    chosen: ReductionStep
    result: Fit

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the supported parameters among all."""
        return tuple(self.parameters.labels.index(label) for label in self.result.parameters.labels)

    @property
    def fit(self) -> Fit:
        """All parameters: as fitted where supported, elsewhere ``assumed`` at their reference."""
        return of_all(self.result, self.parameters, self.reference)

    def __repr__(self) -> str:
        names = self.result.parameters.names
        return (
            f"Reduction to {len(names)} of {len(self.parameters)} parameters, validation error "
            f"{self.chosen.error.mean:.4g} (all: {self.steps[0].error.mean:.4g}):\n  "
            f"{first_of(names, NAMED)}"
        )

    def _repr_html_(self) -> str:
        head = ("parameters", "dropped", "% std", "training error", "validation error", "±")
        rows = [
            (len(s.labels), s.dropped or "", s.relative_std, s.training_error, *s.error[:2])
            for s in self.steps
        ]
        return html_table(head, rows)


@checked
def eliminate(found: Outcome) -> Reduction:
    """Find the parameters of an identification that predictions need.

    At each step the parameter with the largest relative standard deviation goes back to its
    reference, and the others are fitted again. Of all steps, the one with the fewest parameters is
    chosen whose validation error is not clearly above the least (``PredictionError``).

    The reference is the robot file, and zero for joint terms that it gives no value of. What is
    unidentifiable is dropped from the start. Joint terms whose size the evidence decides stay. What
    is essential is not for a prior to say: weighted least squares stands in for Bayes.

    Parameters
    ----------
    found : Identification

    Returns
    -------
    Reduction
        All steps, and the one that is chosen.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> reduction = loopid.identification.eliminate(found)
    >>> len(reduction.chosen.labels) < len(reduction.parameters)
    True
    """
    model, (data, new) = found.force_model, found.parts
    plain, prior = model.plain_columns, np.array(model.prior)
    prior[model.grouped_columns] = found.fit.values[model.grouped_columns]
    held = plain[Excitation.of(model, data.reduced(plain, prior).problem).held]
    return eliminate_parameters(
        *(data, new),
        estimator=found.options.estimator,
        reference=prior,
        free=np.setdiff1d(plain, held),
    )


def judge_essential(found: Outcome, reduction: Reduction) -> Candidate:
    """The essential parameters as one more candidate of an identification."""
    data, new = found.parts
    return judge(
        *(reduction.fit, data, new),
        name="essential parameters",
        against=found.baseline.fit,
        predicted=(new.predicted(reduction.fit.values), found.baseline.predicted),
    )


@checked
def eliminate_parameters(
    training: FitSamples,
    validation: FitSamples,
    *,
    estimator: str | Estimator = "wls",
    reference: FloatArray | None = None,
    free: IntArray | None = None,
) -> Reduction:
    """As ``eliminate``, of different samples of the same parameters and actuators.

    Weights and error model are those of the full model at every step. Dropped parameters have the
    values (n,) of a reference, by default zero. At first all are fitted, or the columns, ascending,
    that are ``free``.
    """
    names = training.parameters
    if (validation.parameters, validation.actuators) != (names, training.actuators):
        raise DataError("validation data must have the parameters and actuators of the training")
    count = len(names)
    start = np.zeros(count) if reference is None else shaped(reference, "reference", count)
    columns = np.arange(count) if free is None else free
    part = training.reduced(columns, start)
    full = working_fit(part, estimator)
    scale = _error_scale(full.result)
    fitted = list(_eliminations(full, part, start, columns, scale))
    errors = prediction_errors(validation, [values for *_, values, _ in fitted], scale)
    steps = tuple(ReductionStep(*f, e) for f, e in zip(fitted, errors, strict=True))
    chosen = [step for step in steps if step.error.as_good][-1]
    kept = [names.labels.index(label) for label in chosen.labels]
    result = quiet_fit(training.reduced(kept, start), estimator)
    return Reduction(names, start, steps, chosen, result)


def _error_scale(full: Fit) -> FloatArray:
    """What turns residuals (dof,) into units of the full model's errors; 0 without samples."""
    noise = full.require_noise()
    deviation, present = noise.deviation, noise.samples > 0
    if not (deviation[present] > 0).all():
        raise DataError(
            "the full model fits the training data without error, so that smaller models cannot be "
            "compared with it: fit measured forces, or simulated ones with noise"
        )
    return np.divide(1.0, deviation, out=np.zeros(len(deviation)), where=present)


def _eliminations(
    full: WorkingFit,
    training: FitSamples,
    start: FloatArray,
    free: IntArray,
    scale: FloatArray,
) -> Iterator[tuple[tuple[str, ...], str | None, float, FloatArray, float]]:
    """First fields of the steps, from all free parameters down to one; the others stay at start.

    Weights, working samples and error model stay those of the full fit, so that no sample is needed
    again. Let R be the weighted triangular factor and C the full covariance. M = R C Rᵀ is the
    covariance of the errors as R sees them. A subset with R_S = Q T has T⁻¹ Qᵀ M Q T⁻ᵀ.
    """
    labels, width, factor = training.parameters.labels, len(free), full.factor
    reference, whole = start[free], start.copy()
    R, force = factor[:width, :width], factor[:width, width]
    columns, dropped, relative = list(range(width)), None, np.nan
    while True:
        values = reference.copy()
        values[columns] = 0.0
        Q, T = np.linalg.qr(R[:, columns])
        values[columns] = solve_triangular(T, Q.T @ (force - R @ values))
        squares = training.problem.residual_squares(values) * scale**2
        error = float(squares.sum() / training.problem.rows)
        whole[free] = values
        yield tuple(labels[j] for j in columns), dropped, relative, whole.copy(), error
        if len(columns) == 1:
            return
        response = np.linalg.inv(T) @ Q.T @ R
        errors = np.sqrt(variances(response, full.result.covariance))
        deviations = relative_deviation(errors, (values - reference)[columns])
        worst = int(np.argmax(deviations))
        dropped, relative = labels[columns.pop(worst)], float(deviations[worst])


class PredictionError(NamedTuple):
    """How well values predict data that were not fitted, beside others.

    Attributes
    ----------
    mean, standard_error : float
        Mean square of scaled residuals over all actuators.
    excess_error : float
        Standard error of the mean less that of the best values; 0 for the best.
    as_good : bool
        Whether the mean is not clearly above the least: within one standard error of it
        [Breiman1984] and two of the difference, or within 2 %.
    """

    mean: float
    standard_error: float
    excess_error: float
    as_good: bool


def prediction_errors(
    validation: FitSamples, candidates: Sequence[FloatArray], scale: FloatArray
) -> list[PredictionError]:
    """Errors of several values (n,) on the same data, each beside the best of them.

    Residuals are multiplied by a scale (dof,); 0 leaves an actuator out.
    """
    present = validation.used & (scale > 0)
    counts = present.sum(axis=1)
    if not counts.any():
        raise DataError("there is no validation sample of an actuator that was fitted")
    residuals = (validation.residual(values) for values in candidates)
    squares = np.array([np.square(each * scale * present).sum(axis=1) for each in residuals])
    means, errors = means_of_series(squares, counts, validation.pieces)
    best = int(np.argmin(means))
    # Of the differences at each time: what both share, as a disturbance that neither explains,
    # does not count as uncertainty.
    excess, excess_errors = means_of_series(squares - squares[best], counts, validation.pieces)
    # One standard error of the best is wide where a disturbance that none explains makes all
    # of them uncertain; two of the difference are not.
    uncertainty = np.minimum(errors[best], CLEARLY * excess_errors)
    as_good = excess <= np.maximum(uncertainty, NO_CONSEQUENCE * means[best])
    columns = (each.tolist() for each in (means, errors, excess_errors, as_good))
    return [PredictionError(*numbers) for numbers in zip(*columns, strict=True)]


@checked
def influence(data: FitSamples, values: FloatArray) -> FloatArray:
    """Size of the forces of the first i parameters, in % of that of the measured forces.

    p_i = |W[:, :i] Φ[:i]| / |T| · 100 for i = 1 to r, the paper's (12), with the base regressor and
    all i up to r. It is a ratio of norms, not an accuracy. It need not grow with i, may exceed 100,
    and depends on the order of the parameters.

    Parameters
    ----------
    data : FitSamples
        With the parameters in the order of elimination.
    values : FloatArray
        (r,).

    Returns
    -------
    FloatArray
        (r,), in %.

    Raises
    ------
    DataError
        When the values have another shape, or the forces are all zero.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.mx", "elbow.Fc"])
    >>> W = np.random.default_rng(0).normal(size=(500, 1, 2))
    >>> samples = loopid.identification.FitSamples.of(names, ["elbow"], W, W @ [4.0, 3.0])
    >>> loopid.identification.influence(samples, np.array([4.0, 3.0])).round(6)[1:]
    array([100.])
    """
    factor, phi = _factor(data, values)
    size = float(np.linalg.norm(factor[:, -1]))
    if not size > 0:
        raise DataError("the measured forces are all zero: influence is undefined")
    sums = np.cumsum(factor[:, :-1] * phi, axis=1)
    return np.asarray(100 * np.linalg.norm(sums, axis=0) / size, dtype=np.float64)


def truncated_values(data: FitSamples, values: FloatArray, count: int) -> FloatArray:
    """Expected values (count,) of a fit of the first parameters when the true model has all n.

    The forces of the others bias them: φ₁ + (W₁ᵀW₁)⁻¹ W₁ᵀW₂ φ₂, whatever the noise. ``values`` (n,)
    are the true ones.
    """
    factor, phi = _factor(data, values)
    force = factor[:, count:-1] @ phi[count:]
    return np.asarray(phi[:count] + np.linalg.lstsq(factor[:, :count], force)[0])


def _factor(data: FitSamples, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Triangular factor (r + 1, r + 1) of [W | T], and checked values (r,)."""
    phi = shaped(values, "values", len(data.parameters))
    return data.problem.weighted(np.ones(len(data.actuators))), phi
