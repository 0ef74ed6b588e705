"""Robust regression by iteratively reweighted least squares [Huber1981].

Let r be the residuals of an actuator, s their scale and m the mean of ψ'. The *pseudo-errors* s ψ(r
/ s) / m add up in the estimates as errors do in least squares. Their variance σ² is what the
actuator counts by, w = 1 / σ. Working forces x φ + s ψ(r / s) / m have the estimates as their least
squares, Σ w² x s ψ(r / s) / m = 0. So each row counts by ψ(r / s) / (r / s) / m.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from loopid.arguments import BoolArray, FloatArray, Positive, row_blocks
from loopid.errors import DataError
from loopid.identification.estimator import (
    Estimator,
    WeightedLeastSquares,
    WorkingFit,
    inverse_deviations,
    leverages,
    result_of,
    solved,
)
from loopid.identification.problem import FitProblem, FitSamples
from loopid.identification.quality import Robustness, fit_quality
from loopid.numbers import FIT_ROUND_OFF
from loopid.records import record
from loopid.workers import one_blas_thread

# Weight below which a sample counts as down-weighted.
DOWN_WEIGHTED = 0.5
# Median of the absolute value of a standard normal variable.
NORMAL_MEDIAN = 0.6744897501960817
# Residual, in units of their scale, from which on all count alike to Huber's estimate.
HUBER_LIMIT = 1.345
# Change of the predicted forces, relative to the scale of their errors, at which bisquare follows
# Huber, and at which it ends.
TOLERANCES = 1e-3, 1e-9
# Iterations at most, and those after which scales and mean slopes are held: single samples would
# let them flip.
ITERATIONS, HELD_FROM = 200, 20
# Mean slope of ψ below which residuals are no normal core with outliers.
LEAST_SLOPE = 0.1


def huber(u: FloatArray, limit: float) -> tuple[FloatArray, FloatArray]:
    """How residuals u, in units of their scale, count: by ψ(u) / u, and ψ'(u).

    Those beyond the limit count as if they were at it.
    """
    return limit / np.maximum(np.abs(u), limit), np.asarray(np.abs(u) <= limit, dtype=np.float64)


def bisquare(u: FloatArray, limit: float) -> tuple[FloatArray, FloatArray]:
    """As ``huber``; residuals beyond the limit do not count at all [Beaton1974]."""
    left = np.maximum(1 - (u / limit) ** 2, 0.0)
    return left**2, left * (1 - 5 * (u / limit) ** 2)


@record(checked=True)
class Bisquare(Estimator):
    """Least squares in which outliers do not count.

    Such sums have many solutions: the one next to Huber's is found, with Huber's scale.

    Attributes
    ----------
    tuning : float
        Residual, in units of their scale, from which on samples do not count. Weighted least
        squares for a large one; by default 95 % as efficient as these where errors are normal.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(500, 1, 2))
    >>> force = W @ [2.0, 0.5] + 0.1 * rng.normal(size=(500, 1))
    >>> force[::20] += 50.0  # outliers
    >>> samples = loopid.identification.FitSamples.of(names, ["motor"], W, force)
    >>> found = loopid.identification.fit(samples, loopid.identification.Bisquare())
    >>> found.values.round(1).tolist(), bool(found.robustness.down_weighted[0] > 0.05)
    ([2.0, 0.5], True)
    """

    name = "bisquare"
    tuning: Positive = 4.685

    def fit_samples(self, samples: FitSamples) -> WorkingFit:
        """As of ``Estimator``, by iteratively reweighted least squares.

        Raises
        ------
        DataError
            Also when more than half of an actuator's samples are fitted without error, or the
            iteration does not converge.
        """
        with one_blas_thread():
            plain = WeightedLeastSquares().fit(samples.problem)
            found = self._iterated(samples, plain.values, plain.weights)
            found = self._iterated(samples, found.values, found.weights, found.scale)
            return self._working_fit(samples, found)

    def _iterated(
        self,
        samples: FitSamples,
        values: FloatArray,
        weights: FloatArray,
        held_scale: FloatArray | None = None,
    ) -> _State:
        """Reweighted until the predicted forces stay; by Huber, with own scales, only roughly."""
        problem = samples.problem
        tolerance = TOLERANCES[held_scale is not None]
        for k in range(ITERATIONS):
            residual = samples.residual(values)
            if k < HELD_FROM:
                scale = _scales(samples, residual) if held_scale is None else held_scale
            if held_scale is None:
                own, slopes = huber(residual / scale, HUBER_LIMIT)
            else:
                own, slopes = bisquare(residual / scale, self.tuning)
            row_weights = own * samples.used
            if k < HELD_FROM:
                counts = (row_weights > 0).sum(axis=0).astype(float)
                slope = _mean_slope(samples, slopes, row_weights > 0)
            squares = ((residual * row_weights / slope) ** 2).sum(axis=0)
            R = problem.weighted(weights)[:-1, :-1]
            weights = inverse_deviations(problem, squares, counts - leverages(problem, weights, R))
            reweighted = FitProblem.combined(
                samples.block_problem(rows, np.sqrt(row_weights[rows] / slope))
                for rows in row_blocks(len(samples))
            )
            last, (values, _) = values, solved(reweighted, weights)
            step = problem.factors[:, :, :-1] @ (values - last)
            if (np.sqrt((step**2).sum(axis=1) / len(samples)) <= tolerance * scale).all():
                return _State(values, weights, scale, slope)
        raise DataError(
            f"the robust fit does not converge in {ITERATIONS} iterations: use wls, or a larger "
            "tuning constant",
            iterations=ITERATIONS,
        )

    def _working_fit(self, samples: FitSamples, state: _State) -> WorkingFit:
        """The least squares that the last state amounts to, without samples of weight zero.

        These would look like samples without error, and spoil the model of autocorrelation.
        """
        residual, present = samples.residual(state.values), samples.problem.samples > 0
        row_weights = bisquare(residual / state.scale, self.tuning)[0] * samples.used
        force = samples.predicted(state.values) + residual * row_weights / state.slope
        working = replace(samples.with_force(force), used=row_weights > 0)
        values, R = solved(working.problem, state.weights)
        result = result_of(self.name, working.problem, values, R, state.weights, 1.0)
        low = ((row_weights < DOWN_WEIGHTED) & samples.used).sum(axis=0)
        share = low / np.maximum(samples.problem.samples, 1)
        robustness = Robustness(
            np.where(present, state.scale, np.nan), np.where(present, share, np.nan)
        )
        quality = fit_quality(samples.problem, values)
        return WorkingFit(result, working).with_result(quality=quality, robustness=robustness)


def _mean_slope(samples: FitSamples, slopes: FloatArray, counting: BoolArray) -> FloatArray:
    """Means (dof,) of ψ' over the samples (N, dof) that count; small without a normal core."""
    counts, sums = counting.sum(axis=0), (slopes * counting).sum(axis=0)
    slope = np.where(counts > 0, sums / np.maximum(counts, 1), 1.0)
    if (slope < LEAST_SLOPE).any():
        name = samples.actuators[int(slope.argmin())]
        raise DataError(
            f"the residuals of {name} have no normal core: mean slope {slope.min():.2g} (least "
            f"{LEAST_SLOPE:g}); use wls, or a larger tuning constant",
            actuator=name,
        )
    return slope


class _State(NamedTuple):
    """Values (n,); weights w, scales s, mean slopes m of the actuators (dof,)."""

    values: FloatArray
    weights: FloatArray
    scale: FloatArray
    slope: FloatArray


def _scales(samples: FitSamples, residual: FloatArray) -> FloatArray:
    """Standard deviations (dof,) of normal errors with the residuals' (N, dof) median size.

    Half of the samples may be outliers. Actuators without samples have scale 1.
    """
    problem, scales = samples.problem, np.ones(len(samples.actuators))
    for i in np.flatnonzero(problem.samples):
        middle = float(np.median(np.abs(residual[samples.used[:, i], i])))
        scales[i] = max(middle / NORMAL_MEDIAN, samples.least_errors[i])
        if scales[i] <= FIT_ROUND_OFF * problem.force_rms[i]:
            raise DataError(
                f"actuator {samples.actuators[i]} is fitted without error in more than half of its "
                "samples: the scale of its errors is undefined; use ols",
                actuator=samples.actuators[i],
            )
    return scales
