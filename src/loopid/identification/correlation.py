"""Intervals that hold when errors follow one another."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import CorrelationWarning
from loopid.identification.error_model import ErrorModel
from loopid.identification.estimator import WorkingFit
from loopid.identification.least_squares import exactly_fitted
from loopid.identification.noise import NoiseModel
from loopid.identification.result import FitResult
from loopid.identification.samples import FitSamples
from loopid.scratch import mapped_rows
from loopid.threads import one_blas_thread

# Rounds of adding back what a fit takes up of its errors: on slow errors each adds half as much.
CORRECTIONS = 6
# Effective samples, relative to all, below which a user is told.
CLEARLY_FEWER = 0.5


def with_correlated_errors(fit: WorkingFit) -> WorkingFit:
    """The same estimates, their covariance under autoregressive errors of each actuator.

    The covariance is (XᵀX)⁻¹ XᵀΩX (XᵀX)⁻¹ with Ω the covariance of the weighted errors; errors of
    different actuators count as independent. Rows of a prior are in X, their errors in Ω. A
    posterior stays what it is where errors are independent: it may know of their size beforehand.
    """
    result, samples = fit.result, fit.samples
    with one_blas_thread():
        width = len(result.parameters)
        inverse = np.asarray(np.linalg.inv(fit.factor[:width, :width]), dtype=np.float64)
        known = _known(fit.prior, inverse)
        models = _error_models(result, samples, inverse)
        for _ in range(CORRECTIONS):
            sums = known + _total(models)
            for model in models.values():
                model.correct(sums)
        covariance = inverse @ (known + _total(models)) @ inverse.T
    noise = _noise_model(result, models)
    if fit.prior is not None and not noise.coefficients.any():
        return replace(fit, result=replace(result, noise=noise))
    taken = 0 if fit.prior is not None else width
    freedom = float(noise.effective_samples.sum()) - taken
    found = replace(result, covariance=covariance, degrees_of_freedom=freedom, noise=noise)
    return replace(fit, result=found)


def warn_of_correlation(result: FitResult, independent: FitResult) -> None:
    """Name the actuators that have clearly fewer effective samples than rows."""
    noise = result.noise
    if noise is None:
        return
    few = noise.effective_samples < CLEARLY_FEWER * noise.samples
    if not few.any():
        return
    warnings.warn(
        f"the errors of {'; '.join(_about(noise, int(i)) for i in np.flatnonzero(few))} follow one "
        f"another: {_consequence(result, independent)}",
        CorrelationWarning,
        stacklevel=3,
    )


def _known(prior: FloatArray | None, inverse: FloatArray) -> FloatArray:
    """What errors of a prior's rows (k, n + 1) add to the sums (n, n)."""
    width = len(inverse)
    rows = np.zeros((0, width)) if prior is None else prior[:, :width] @ inverse
    return np.asarray(rows.T @ rows, dtype=np.float64)


def _error_models(
    result: FitResult, samples: FitSamples, inverse: FloatArray
) -> dict[int, ErrorModel]:
    """A model for each actuator that has samples, by its number."""
    residual = samples.residual(result.values)
    # Round-off of an exact fit follows itself too, but is no error.
    squares = samples.problem.residual_squares(result.values)
    exact = exactly_fitted(samples.problem, squares)
    models = {}
    for i in map(int, np.flatnonzero(samples.problem.samples)):
        weight = float(result.weights[i])
        models[i] = ErrorModel(
            columns=_columns(samples, i, weight * inverse),
            residual=_scaled(residual[:, i], 0.0 if exact[i] else weight),
            used=samples.used[:, i],
            pieces=samples.pieces,
            least=weight * float(samples.least_errors[i]),
        )
    return models


def _columns(samples: FitSamples, i: int, inverse: FloatArray) -> FloatArray:
    """Regressor (N, n) of one actuator times a matrix, zero where it is not used."""
    W, used = samples.regressor[:, i], samples.used[:, i, None]
    return mapped_rows(lambda rows: (W[rows] @ inverse) * used[rows], len(samples))


def _scaled(series: FloatArray, factor: float) -> FloatArray:
    return mapped_rows(lambda rows: factor * series[rows], len(series))


def _total(models: dict[int, ErrorModel]) -> FloatArray:
    return np.asarray(sum(model.sums for model in models.values()), dtype=np.float64)


def _noise_model(result: FitResult, models: dict[int, ErrorModel]) -> NoiseModel:
    dof = len(result.actuators)
    order = max((model.model.order for model in models.values()), default=0)
    coefficients, numbers = np.zeros((dof, order)), np.full((4, dof), np.nan)
    samples = np.zeros(dof, dtype=np.int64)
    numbers[3] = 0.0
    for i, errors in models.items():
        model, lags = errors.model, np.append(errors.model.covariances, 0.0)
        coefficients[i, : model.order] = model.coefficients
        scale, deviation = 1 / result.weights[i], np.sqrt(lags[0])
        lag_one = lags[1] / lags[0] if lags[0] > 0 else 0.0
        numbers[:3, i] = scale * np.sqrt(model.variance), scale * deviation, lag_one
        numbers[3, i] = errors.effective_samples()
        samples[i] = errors.samples
    innovation, total, lag_one, effective = numbers
    return NoiseModel(
        result.actuators, coefficients, innovation, total, lag_one, samples, effective
    )


def _about(noise: NoiseModel, i: int) -> str:
    return (
        f"{noise.actuators[i]} (lag-one autocorrelation {noise.lag_one[i]:.3f}, "
        f"{noise.effective_samples[i]:.0f} effective of {noise.samples[i]} samples)"
    )


def _consequence(result: FitResult, independent: FitResult) -> str:
    reach, plain = (np.ptp(fit.intervals(), axis=1) for fit in (result, independent))
    ratio = reach / plain
    if not np.isfinite(ratio).all():
        return f"too few effective samples for intervals of {len(ratio)} parameters"
    extent = f"{ratio.min():.1f} to {ratio.max():.1f} times"
    return f"intervals are {extent} as wide as those of independent errors"
