"""Robust regression by iteratively reweighted least squares [Huber1981].

With residuals r of an actuator and their scale s, the *pseudo-errors* s ψ(r / s) / m, m the mean of
ψ', add up in the estimates as errors do in least squares: their variance σ² is what the actuator
counts by, w = 1 / σ, and working forces x φ + s ψ(r / s) / m have the estimates as their least
squares, Σ w² x s ψ(r / s) / m = 0. So each row counts by ψ(r / s) / (r / s) / m.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import BoolArray, FloatArray, frozen
from loopid.errors import DataError, OptionError
from loopid.identification.least_squares import (
    Estimator,
    WeightedLeastSquares,
    WorkingFit,
    inverse_deviations,
    leverages,
    result_of,
    solved,
)
from loopid.identification.problem import ROUND_OFF, FitProblem, FitSamples
from loopid.identification.result import Robustness, fit_quality
from loopid.scratch import mapped_rows, row_blocks
from loopid.workers import one_blas_thread

ITERATIONS = 200
# Change of the predicted forces, relative to the scale of their errors, that ends the iteration,
# and that of Huber's from which on bisquare takes over.
TOLERANCE, START_TOLERANCE = 1e-9, 1e-3
# Iterations after which scales and mean slopes are held: single samples would let them flip.
HELD_FROM = 20
# Mean slope of ψ below which residuals are no normal core with outliers.
LEAST_SLOPE = 0.1
# Weight below which a sample counts as down-weighted.
DOWN_WEIGHTED = 0.5
# Median of the absolute value of a standard normal variable.
NORMAL_MEDIAN = 0.6744897501960817


@dataclass(frozen=True)
class _State:
    """Values (n,); weights w, scales s, mean slopes m of the actuators (dof,)."""

    values: FloatArray
    weights: FloatArray
    scale: FloatArray
    slope: FloatArray


@dataclass(frozen=True)
class RobustEstimator(Estimator, ABC):
    """Least squares in which large residuals count less [Huber1981].

    Attributes
    ----------
    tuning : float
        Residual, in units of their scale, from which on samples count less (Huber) or not at all
        (bisquare). Weighted least squares for a large one; by default 95 % as efficient as these
        where errors are normal.
    """

    tuning: float

    def __post_init__(self) -> None:
        if not 0 < self.tuning < np.inf:
            raise OptionError(f"the tuning constant must be above 0, not {self.tuning}")

    @abstractmethod
    def weight(self, u: FloatArray) -> FloatArray:
        """ψ(u) / u, from 0 to 1, of residuals u in units of their scale."""

    @abstractmethod
    def slope(self, u: FloatArray) -> FloatArray:
        """Derivative ψ'(u)."""

    def fit_samples(self, samples: FitSamples) -> WorkingFit:
        """As of ``Estimator``, by iteratively reweighted least squares.

        Raises
        ------
        DataError
            Also when more than half of an actuator's samples are fitted without error, or the
            iteration does not converge.
        """
        with one_blas_thread():
            return self._working_fit(samples, self._converged(samples, TOLERANCE))

    def _converged(self, samples: FitSamples, tolerance: float) -> _State:
        """From weighted least squares on."""
        plain = WeightedLeastSquares().fit(samples.problem)
        return self._iterated(samples, plain.values, plain.weights, None, tolerance)

    def _iterated(
        self,
        samples: FitSamples,
        values: FloatArray,
        weights: FloatArray,
        held_scale: FloatArray | None,
        tolerance: float,
    ) -> _State:
        """Reweighted until the predicted forces stay."""
        problem = samples.problem
        for k in range(ITERATIONS):
            residual = samples.residual(values)
            if k < HELD_FROM:
                scale = _scales(samples, residual) if held_scale is None else held_scale
                row_weights = self._row_weights(samples, residual, scale)
                counts = (row_weights > 0).sum(axis=0).astype(float)
                slope = self._mean_slope(samples, residual / scale, row_weights > 0)
            else:
                row_weights = self._row_weights(samples, residual, scale)
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
            f"tuning constant than {self.tuning:g}"
        )

    def _row_weights(
        self, samples: FitSamples, residual: FloatArray, scale: FloatArray
    ) -> FloatArray:
        """Weights ψ(u) / u (N, dof) from 0 to 1; 0 where not used."""
        used = samples.used
        return mapped_rows(lambda r: self.weight(residual[r] / scale) * used[r], len(residual))

    def _mean_slope(self, samples: FitSamples, u: FloatArray, counting: BoolArray) -> FloatArray:
        """Means (dof,) of ψ' over the samples (N, dof) that count."""
        counts, sums = counting.sum(axis=0), (self.slope(u) * counting).sum(axis=0)
        slope = np.where(counts > 0, sums / np.maximum(counts, 1), 1.0)
        if (slope < LEAST_SLOPE).any():
            raise DataError(
                f"the residuals of {samples.actuators[int(slope.argmin())]} have no normal "
                f"core: mean slope {slope.min():.2g} (least {LEAST_SLOPE:g}); use wls, or a larger "
                f"tuning constant than {self.tuning:g}"
            )
        return slope

    def _working_fit(self, samples: FitSamples, state: _State) -> WorkingFit:
        """The least squares that the last state amounts to, without samples of weight zero.

        These would look like samples without error, and spoil the model of autocorrelation.
        """
        residual, present = samples.residual(state.values), samples.problem.samples > 0
        row_weights = self._row_weights(samples, residual, state.scale)
        force = samples.predicted(state.values) + residual * row_weights / state.slope
        used = frozen(row_weights > 0, np.bool_)
        working = replace(samples.with_force(force), used=used)
        values, R = solved(working.problem, state.weights)
        result = result_of(self.name, working.problem, values, R, state.weights, 1.0)
        low = ((row_weights < DOWN_WEIGHTED) & samples.used).sum(axis=0)
        share = low / np.maximum(samples.problem.samples, 1)
        robustness = Robustness(
            np.where(present, state.scale, np.nan), np.where(present, share, np.nan)
        )
        quality = fit_quality(samples.problem, values)
        return WorkingFit(replace(result, quality=quality, robustness=robustness), working)


@checked_fields
@dataclass(frozen=True)
class Huber(RobustEstimator):
    """Residuals beyond a limit c count as if they were at it: ψ(u) = min(|u|, c) sign u.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(500, 1, 2))
    >>> force = W @ [2.0, 0.5] + 0.1 * rng.standard_t(3, size=(500, 1))  # heavy tails
    >>> samples = loopid.identification.FitSamples.of(names, ["motor"], W, force)
    >>> loopid.fit(samples, loopid.identification.Huber()).values.round(1).tolist()
    [2.0, 0.5]
    """

    name = "huber"
    tuning: float = 1.345

    def weight(self, u: FloatArray) -> FloatArray:
        return np.asarray(self.tuning / np.maximum(np.abs(u), self.tuning))

    def slope(self, u: FloatArray) -> FloatArray:
        return np.asarray(np.abs(u) <= self.tuning, dtype=np.float64)


@checked_fields
@dataclass(frozen=True)
class Bisquare(RobustEstimator):
    """Residuals beyond a limit c do not count at all [Beaton1974]: ψ(u) = u (1 - (u / c)²)².

    Such sums have many solutions: the one next to Huber's is found, with Huber's scale.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(500, 1, 2))
    >>> force = W @ [2.0, 0.5] + 0.1 * rng.normal(size=(500, 1))
    >>> force[::20] += 50.0  # outliers
    >>> samples = loopid.identification.FitSamples.of(names, ["motor"], W, force)
    >>> found = loopid.fit(samples, loopid.identification.Bisquare())
    >>> found.values.round(1).tolist(), bool(found.robustness.down_weighted[0] > 0.05)
    ([2.0, 0.5], True)
    """

    name = "bisquare"
    tuning: float = 4.685

    def weight(self, u: FloatArray) -> FloatArray:
        return np.asarray(np.maximum(1 - (u / self.tuning) ** 2, 0.0) ** 2)

    def slope(self, u: FloatArray) -> FloatArray:
        square = (u / self.tuning) ** 2
        return np.where(square < 1, (1 - square) * (1 - 5 * square), 0.0)

    def _converged(self, samples: FitSamples, tolerance: float) -> _State:
        start = Huber()._converged(samples, START_TOLERANCE)
        return self._iterated(samples, start.values, start.weights, start.scale, tolerance)


def _scales(samples: FitSamples, residual: FloatArray) -> FloatArray:
    """Standard deviations (dof,) of normal errors with the residuals' (N, dof) median size.

    Half of the samples may be outliers. Actuators without samples have scale 1.
    """
    problem, scales = samples.problem, np.ones(len(samples.actuators))
    for i in np.flatnonzero(problem.samples):
        middle = float(np.median(np.abs(residual[samples.used[:, i], i])))
        scales[i] = max(middle / NORMAL_MEDIAN, samples.least_errors[i])
        if scales[i] <= ROUND_OFF * problem.force_rms[i]:
            raise DataError(
                f"actuator {samples.actuators[i]} is fitted without error in more than half of its "
                "samples: the scale of its errors is undefined; use ols"
            )
    return scales
