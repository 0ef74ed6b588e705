"""Robust regression by iteratively reweighted least squares [Huber1981].

With residuals r of an actuator and their scale s, the *pseudo-errors* s ψ(r / s) / m, m the mean of
ψ', add up in the estimates as errors do in least squares: their variance σ² is what the actuator
counts by, w = 1 / σ, and working forces x φ + s ψ(r / s) / m have the estimates as their least
squares, Σ w² x s ψ(r / s) / m = 0. So each row counts by ψ(r / s) / (r / s) / m.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray, frozen
from loopid.errors import DataError, OptionError
from loopid.identification.least_squares import (
    SampleEstimator,
    WeightedLeastSquares,
    WorkingFit,
    inverse_deviations,
    leverages,
    result_of,
    solved,
)
from loopid.identification.problem import ROUND_OFF, FitProblem, FitSamples
from loopid.identification.quality import Robustness, fit_quality
from loopid.scratch import mapped_rows, row_blocks
from loopid.threads import one_blas_thread

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
class RobustEstimator(SampleEstimator):
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
            return self._converged(samples, TOLERANCE).working_fit()

    def _converged(self, samples: FitSamples, tolerance: float) -> Iterate:
        """The last iterate, from weighted least squares on."""
        plain = WeightedLeastSquares().fit(samples.problem)
        counts, slope = samples.problem.samples.astype(float), np.ones(len(samples.actuators))
        scale = residual_scales(samples, samples.residual(plain.values))
        start = Iterate(samples, self, plain.values, scale, counts, slope, plain.weights)
        return start.iterated(tolerance)


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
    >>> loopid.fit(samples, loopid.Huber()).values.round(1).tolist()
    [2.0, 0.5]
    """

    name = "huber"
    tuning: float = 1.345

    def weight(self, u: FloatArray) -> FloatArray:
        """As of ``RobustEstimator``."""
        return np.asarray(self.tuning / np.maximum(np.abs(u), self.tuning))

    def slope(self, u: FloatArray) -> FloatArray:
        """As of ``RobustEstimator``."""
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
    >>> found = loopid.fit(samples, loopid.Bisquare())
    >>> found.values.round(1).tolist(), bool(found.robustness.down_weighted[0] > 0.05)
    ([2.0, 0.5], True)
    """

    name = "bisquare"
    tuning: float = 4.685

    def weight(self, u: FloatArray) -> FloatArray:
        """As of ``RobustEstimator``."""
        return np.asarray(np.maximum(1 - (u / self.tuning) ** 2, 0.0) ** 2)

    def slope(self, u: FloatArray) -> FloatArray:
        """As of ``RobustEstimator``."""
        square = (u / self.tuning) ** 2
        return np.where(square < 1, (1 - square) * (1 - 5 * square), 0.0)

    def _converged(self, samples: FitSamples, tolerance: float) -> Iterate:
        start = Huber()._converged(samples, START_TOLERANCE)
        return replace(start, score=self).iterated(tolerance, hold_scale=True)


@dataclass(frozen=True)
class Iterate:
    """Values (n,); scales s, samples that count, mean slopes m, weights w of actuators (dof,)."""

    samples: FitSamples
    score: RobustEstimator
    values: FloatArray
    scale: FloatArray
    counts: FloatArray
    slope: FloatArray
    weights: FloatArray

    def iterated(self, tolerance: float, hold_scale: bool = False) -> Iterate:
        """Reweighted until the predicted forces stay.

        Raises
        ------
        DataError
            When they do not, or residuals have no normal core.
        """
        state, samples, problem = self, self.samples, self.samples.problem
        for k in range(ITERATIONS):
            if k < HELD_FROM:
                state = state._with_slopes(hold_scale)
            R = problem.weighted(state.weights)[:-1, :-1]
            freedom = state.counts - leverages(problem, state.weights, R)
            weights = inverse_deviations(problem, (state.errors**2).sum(axis=0), freedom)
            blocks = map(state._reweighted, row_blocks(len(samples)))
            values, _ = solved(FitProblem.combined(blocks), weights)
            step = problem.factors[:, :, :-1] @ (values - state.values)
            moved = np.sqrt((step**2).sum(axis=1) / len(samples))
            state = replace(state, values=values, weights=weights)
            if (moved <= tolerance * state.scale).all():
                return state
        raise DataError(
            f"the robust fit does not converge in {ITERATIONS} iterations: use wls, or a larger "
            f"tuning constant than {self.score.tuning:g}"
        )

    def working_fit(self) -> WorkingFit:
        """The least squares that the iterate amounts to, without samples of weight zero.

        These would look like samples without error, and spoil the model of autocorrelation.
        """
        force = self.samples.predicted(self.values) + self.errors
        used = frozen(self.row_weights > 0, np.bool_)
        working = replace(self.samples.with_force(force), used=used)
        values, R = solved(working.problem, self.weights)
        result = result_of(self.score.name, working.problem, values, R, self.weights, 1.0)
        counts, low = self.samples.problem.samples, (self.row_weights < DOWN_WEIGHTED)
        share = (low & self.samples.used).sum(axis=0) / np.maximum(counts, 1)
        present = counts > 0
        robustness = Robustness(
            np.where(present, self.scale, np.nan), np.where(present, share, np.nan)
        )
        quality = fit_quality(self.samples.problem, values)
        return WorkingFit(replace(result, quality=quality, robustness=robustness), working)

    @cached_property
    def residual(self) -> FloatArray:
        """Residuals (N, dof)."""
        return self.samples.residual(self.values)

    @cached_property
    def row_weights(self) -> FloatArray:
        """Weights ψ(u) / u (N, dof) from 0 to 1; 0 where not used."""
        residual, used = self.residual, self.samples.used

        def weights(rows: slice) -> FloatArray:
            return self.score.weight(residual[rows] / self.scale) * used[rows]

        return mapped_rows(weights, len(residual))

    @property
    def errors(self) -> FloatArray:
        """Pseudo-errors (N, dof)."""
        return self.residual * self.row_weights / self.slope

    def _reweighted(self, rows: slice) -> FitProblem:
        """Some samples, each row times the root of its weight."""
        return self.samples.block_problem(rows, np.sqrt(self.row_weights[rows] / self.slope))

    def _with_slopes(self, hold_scale: bool) -> Iterate:
        """With the scales, unless held, and the means of ψ' over the samples that count."""
        scale = self.scale if hold_scale else residual_scales(self.samples, self.residual)
        state = replace(self, scale=scale)
        counting = state.row_weights > 0
        counts = counting.sum(axis=0).astype(float)
        sums = (self.score.slope(self.residual / scale) * counting).sum(axis=0)
        slope = np.where(counts > 0, sums / np.maximum(counts, 1), 1.0)
        if (slope < LEAST_SLOPE).any():
            raise DataError(
                f"the residuals of {self.samples.actuators[int(slope.argmin())]} have no normal "
                f"core: mean slope {slope.min():.2g} (least {LEAST_SLOPE:g}); use wls, or a larger "
                f"tuning constant than {self.score.tuning:g}"
            )
        return replace(state, counts=counts, slope=slope)


def residual_scales(samples: FitSamples, residual: FloatArray) -> FloatArray:
    """Standard deviations (dof,) of normal errors with the residuals' median size.

    Half of the samples may be outliers. Actuators without samples have scale 1.

    Raises
    ------
    DataError
        When more than half of an actuator's residuals (N, dof) are but round-off.
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
