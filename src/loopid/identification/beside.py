"""Columns beside all that is fitted: how likely the forces are with what is left of them.

Least squares with further columns are those of what the fitted ones leave of these and of the
forces [FrischWaugh1933]. Coefficients of the columns are N(0, σ²), at the likeliest of several σ.
"""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray
from loopid.identification.problem import FitSamples
from loopid.workers import one_blas_thread

# Deviations that are tried, relative to the motor's force, and the logarithm of how much likelier
# the data are with the best of them for columns to come into question.
TRIED, POSSIBLE = np.geomspace(1e-3, 1.0, 7), 0.5
# Of the largest singular value, and of what there is of columns: combinations below have no effect.
DETERMINED, LEFT = 1e-6, 1e-10


class Beside:
    """Samples, and what all their parameters leave of forces and of further columns.

    ``weights`` (dof,) are one over the deviations of the forces.
    """

    def __init__(self, samples: FitSamples, weights: FloatArray) -> None:
        self.samples, self.weights = samples, weights
        with one_blas_thread():
            *_, R, y = np.split(samples.problem.weighted(weights), [0, -1], axis=1)
            _, values, V = np.linalg.svd(R, full_matrices=False)
            keep = values > DETERMINED * values[:1]
            self.turn = V[keep].T / values[keep]
            self.fitted = self.turn @ (self.turn.T @ (R.T @ y[:, 0]))
        self.residual = samples.residual(self.fitted)

    def evidence(self, row: int, columns: FloatArray) -> float:
        """``evidence_of`` columns (N, k) in the force of a motor."""
        samples, used, weight = self.samples, self.samples.used[:, row], self.weights[row]
        c = weight * columns[used]
        turned = (weight * samples.regressor[used, row] @ self.turn).T @ c
        squares, V = np.linalg.eigh(c.T @ c - turned.T @ turned)
        keep = squares > LEFT * (c * c).sum()
        size, V = np.sqrt(squares[keep]), V[:, keep]
        left = (V.T @ (c.T @ (weight * self.residual[used, row]))) / size
        return evidence_of(size[:, None] * V.T, left, float(samples.problem.force_rms[row]))


def evidence_of(columns: FloatArray, left: FloatArray, size: float) -> float:
    """Logarithm of how much likelier residuals (r,) are with columns (r, k) than without.

    At the likeliest deviation of their forces, of errors of unit variance; ``size`` is that of the
    motor's force.
    """
    U, values, _ = np.linalg.svd(columns, full_matrices=False)
    ratios = np.multiply.outer(TRIED * size, values) ** 2
    gains = ratios / (1 + ratios) * (U.T @ left) ** 2 - np.log1p(ratios)
    return float(gains.sum(axis=1).max() / 2)
