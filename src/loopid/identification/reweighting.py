"""Iteratively reweighted least squares [Huber1981].

With residuals r of an actuator and their scale s, the *pseudo-errors* s ψ(r / s) / m, m the mean of
ψ', add up in the estimates as errors do in least squares: their variance σ² is what the actuator
counts by, w = 1 / σ, and working forces x φ + s ψ(r / s) / m have the estimates as their least
squares, Σ w² x s ψ(r / s) / m = 0. So each row counts by ψ(r / s) / (r / s) / m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import DataError
from loopid.identification.estimator import leverages, solved
from loopid.identification.least_squares import inverse_deviations
from loopid.identification.problem import FitProblem
from loopid.identification.residual_scale import residual_scales
from loopid.identification.samples import FitSamples
from loopid.scratch import row_blocks

ITERATIONS = 200
# Change of the predicted forces, relative to the scale of their errors, that ends the iteration.
TOLERANCE = 1e-9
# Iterations after which scales and mean slopes are held: single samples would let them flip.
HELD_FROM = 20
# Mean slope of ψ below which residuals are no normal core with outliers.
LEAST_SLOPE = 0.1


class Score(Protocol):
    """A function ψ that grows less than its argument."""

    @property
    def tuning(self) -> float:
        """Residual, in units of their scale, from which on samples count less."""

    def weight(self, u: FloatArray) -> FloatArray:
        """ψ(u) / u, from 0 to 1, of residuals u in units of their scale."""

    def slope(self, u: FloatArray) -> FloatArray:
        """Derivative ψ'(u)."""


@dataclass(frozen=True)
class Iterate:
    """Values (n,); scales s, samples that count, mean slopes m, weights w of actuators (dof,)."""

    values: FloatArray
    scale: FloatArray
    counts: FloatArray
    slope: FloatArray
    weights: FloatArray


class Reweighting:
    """The sums over samples that an iteration needs, block by block."""

    def __init__(self, samples: FitSamples, score: Score) -> None:
        self.samples, self.score = samples, score

    def iterated(
        self, state: Iterate, hold_scale: bool = False, tolerance: float = TOLERANCE
    ) -> Iterate:
        """Weighted again and again until the predicted forces stay.

        Raises
        ------
        DataError
            When they do not, or residuals have no normal core.
        """
        problem = self.samples.problem
        for k in range(ITERATIONS):
            if k < HELD_FROM:
                scale = state.scale if hold_scale else residual_scales(self.samples, state.values)
                state = self._with_slopes(replace(state, scale=scale))
            state = replace(state, weights=self._weights(state))
            values, _ = solved(self._reweighted(state), state.weights)
            step = problem.factors[:, :, :-1] @ (values - state.values)
            moved = np.sqrt((step**2).sum(axis=1) / len(self.samples))
            state = replace(state, values=values)
            if (moved <= tolerance * state.scale).all():
                return state
        raise DataError(
            f"the robust fit does not settle in {ITERATIONS} iterations: use wls, or a larger "
            f"tuning constant than {self.score.tuning:g}"
        )

    def errors(self, state: Iterate, rows: slice) -> FloatArray:
        """Pseudo-errors (L, dof) of some rows, zero where not used."""
        part = self.residual(state, rows) * self.row_weights(state, rows) / state.slope
        return np.asarray(part * self.samples.used[rows], dtype=np.float64)

    def row_weights(self, state: Iterate, rows: slice) -> FloatArray:
        """What some rows (L, dof) count by, from 0 to 1."""
        return self.score.weight(self.residual(state, rows) / state.scale)

    def counting(self, state: Iterate, rows: slice) -> BoolArray:
        """Which of some rows (L, dof) count at all: those whose weight is zero are left out."""
        return np.asarray(self.samples.used[rows] & (self.row_weights(state, rows) > 0))

    def residual(self, state: Iterate, rows: slice) -> FloatArray:
        """Residuals (L, dof) of some rows."""
        predicted = self.samples.regressor[rows] @ state.values
        return np.asarray(self.samples.force[rows] - predicted, dtype=np.float64)

    def _with_slopes(self, state: Iterate) -> Iterate:
        """The state with the means of ψ' over the samples that count; 1 where none does."""
        sums, counts = np.zeros(len(state.scale)), np.zeros(len(state.scale))
        for rows in row_blocks(len(self.samples)):
            slopes = self.score.slope(self.residual(state, rows) / state.scale)
            counting = self.counting(state, rows)
            sums, counts = sums + (slopes * counting).sum(axis=0), counts + counting.sum(axis=0)
        slope = np.where(counts > 0, sums / np.maximum(counts, 1), 1.0)
        if (slope < LEAST_SLOPE).any():
            raise DataError(
                f"the residuals of {self.samples.actuators[int(slope.argmin())]} have no normal "
                f"core: mean slope {slope.min():.2g} (least {LEAST_SLOPE:g}); use wls, or a larger "
                f"tuning constant than {self.score.tuning:g}"
            )
        return replace(state, counts=counts, slope=slope)

    def _weights(self, state: Iterate) -> FloatArray:
        """Inverse deviations (dof,) of the pseudo-errors."""
        problem, width = self.samples.problem, len(state.values)
        squares = np.zeros(len(state.scale))
        for rows in row_blocks(len(self.samples)):
            squares += (self.errors(state, rows) ** 2).sum(axis=0)
        R = problem.weighted(state.weights)[:width, :width]
        freedom = state.counts - leverages(problem, state.weights, R)
        return inverse_deviations(problem, squares, freedom)

    def _reweighted(self, state: Iterate) -> FitProblem:
        """The samples, each row times the root of its weight."""
        blocks = row_blocks(len(self.samples))
        return FitProblem.combined(self._reweighted_block(state, rows) for rows in blocks)

    def _reweighted_block(self, state: Iterate, rows: slice) -> FitProblem:
        samples, root = self.samples, np.sqrt(self.row_weights(state, rows) / state.slope)
        return FitProblem.from_samples(
            samples.regressor[rows] * root[:, :, None],
            samples.force[rows] * root,
            samples.parameters,
            samples.actuators,
            samples.used[rows],
            samples.least_errors,
        )
