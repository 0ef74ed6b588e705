"""Robust regression: samples with large residuals count less."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.identification.estimator import (
    SampleEstimator,
    WorkingFit,
    require_rows,
    result_of,
    solved,
)
from loopid.identification.least_squares import WeightedLeastSquares
from loopid.identification.quality import fit_quality
from loopid.identification.residual_scale import residual_scales
from loopid.identification.reweighting import TOLERANCE, Iterate, Reweighting
from loopid.identification.robustness import Robustness
from loopid.identification.samples import FitSamples
from loopid.scratch import mapped_rows, row_blocks
from loopid.threads import one_blas_thread

# Change of Huber's predicted forces, relative to the scale of their errors, from which on bisquare
# takes over.
START_TOLERANCE = 1e-3
# Weight below which a sample counts as down-weighted.
DOWN_WEIGHTED = 0.5


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
            iteration does not settle.
        """
        require_rows(samples.problem)
        with one_blas_thread():
            return self._working_fit(samples, self._settled(samples))

    def _settled(self, samples: FitSamples, tolerance: float = TOLERANCE) -> Iterate:
        """The last iterate, from weighted least squares on."""
        plain = WeightedLeastSquares().fit(samples.problem)
        scale = residual_scales(samples, plain.values)
        counts, slope = np.asarray(samples.problem.samples, dtype=np.float64), np.ones(len(scale))
        start = Iterate(plain.values, scale, counts, slope, plain.weights)
        return Reweighting(samples, self).iterated(start, tolerance=tolerance)

    def _working_fit(self, samples: FitSamples, state: Iterate) -> WorkingFit:
        """The least squares that the last iterate amounts to, without samples of weight zero.

        These would look like samples without error, and break the model of how errors follow one
        another.
        """
        sums = Reweighting(samples, self)
        force = mapped_rows(
            lambda rows: samples.regressor[rows] @ state.values + sums.errors(state, rows),
            len(samples),
        )
        counting = mapped_rows(lambda rows: sums.counting(state, rows), len(samples))
        working = replace(samples, force=force, used=counting)
        values, R = solved(working.problem, state.weights)
        result = result_of(self.name, working.problem, values, R, state.weights, 1.0)
        quality = fit_quality(samples.problem, values)
        found = replace(result, quality=quality, robustness=_robustness(sums, state))
        return WorkingFit(found, working)


@checked_fields
@dataclass(frozen=True)
class Huber(RobustEstimator):
    """Residuals beyond a limit c count as if they were at it: ψ(u) = min(|u|, c) sign u."""

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

    Many estimates solve such sums: those next to Huber's are found, with Huber's scale.
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

    def _settled(self, samples: FitSamples, tolerance: float = TOLERANCE) -> Iterate:
        start = Huber()._settled(samples, START_TOLERANCE)
        return Reweighting(samples, self).iterated(start, True, tolerance)


def _robustness(sums: Reweighting, state: Iterate) -> Robustness:
    counts, low = sums.samples.problem.samples, np.zeros(len(state.scale))
    for rows in row_blocks(len(sums.samples)):
        low += ((sums.row_weights(state, rows) < DOWN_WEIGHTED) & sums.samples.used[rows]).sum(0)
    present = counts > 0
    share = np.where(present, low / np.maximum(counts, 1), np.nan)
    return Robustness(np.where(present, state.scale, np.nan), share)
