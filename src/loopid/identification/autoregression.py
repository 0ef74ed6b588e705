"""Autoregressive errors, and what they do to sums over them [Percival1993]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import lfilter

from loopid.arrays import FloatArray

# Keeps models of errors that hardly return to zero from never returning.
LARGEST_REFLECTION = 0.9999
# Of the time that a sum over the endless past runs to: 2**40 samples.
DOUBLINGS = 40


@dataclass(frozen=True)
class Autoregression:
    """e_t = Σ c_k e_{t-k} + ε_t, ε independent.

    Attributes
    ----------
    coefficients : FloatArray
        (p,), c_k.
    variance : float
        Of ε.
    """

    coefficients: FloatArray
    variance: float

    @classmethod
    def of_covariances(
        cls, covariances: FloatArray, limit: float = LARGEST_REFLECTION
    ) -> Autoregression:
        """The model with autocovariances (p + 1,) at lags 0 to p, by Levinson's recursion.

        No process has covariances that ask for a reflection coefficient of 1 or more; where they
        do, or ask for more than a limit below 1, the model ends at that lag with the limit.
        """
        polynomial, variance = np.ones(1), float(covariances[0])
        for k in range(1, len(covariances)):
            asked = -float(polynomial @ covariances[k:0:-1]) / variance
            reflection = float(np.clip(asked, -limit, limit))
            polynomial, variance = raised(polynomial, reflection), variance * (1 - reflection**2)
            if reflection != asked:
                break
        return cls(-polynomial[1:], variance)

    @property
    def order(self) -> int:
        """How many earlier errors it looks back on."""
        return len(self.coefficients)

    @property
    def polynomial(self) -> FloatArray:
        """(p + 1,), A of A(z) e = ε: 1, then -c_k."""
        return np.append(1.0, -self.coefficients)

    def covariances(self) -> FloatArray:
        """Autocovariances (p + 1,) at lags 0 to p."""
        return self._lags_from(np.append(self.variance, np.zeros(self.order)))

    def sum_covariance(self, parts: Sequence[FloatArray]) -> FloatArray:
        """Covariance (m, m) of Σ_t x_t e_t over parts (L, m) of evenly spaced rows x_t.

        Exact for errors that began long before the first row of each part.
        """
        total: FloatArray = np.zeros((parts[0].shape[1], parts[0].shape[1]))
        for part in parts:
            filtered, state = self._filtered(part)
            total += filtered.T @ filtered
            if self.order:
                total += state.T @ self._tail @ state
        return self.variance * total

    def lagged_sums(self, parts: Sequence[FloatArray]) -> FloatArray:
        """Σ_t Σ_s x_t·x_s Cov(e_t, e_{s+k}) of parts (L, m), at lags k = 0 to p; (p + 1,).

        Products y_t·y_{t+k} of the filtered columns, summed over the endless past too: with A
        applied to the first factor, only rows of the data are left.
        """
        products = np.zeros(self.order + 1)
        for part in parts:
            flat, filtered = part.ravel(), self._filtered(part)[0].ravel()
            shifts = np.minimum(np.arange(self.order + 1) * part.shape[1], len(flat))
            products += [flat[: len(flat) - shift] @ filtered[shift:] for shift in shifts]
        return self.variance * self._lags_from(products)

    def _filtered(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns filtered backwards in time by 1/A (L, m), and the state before the first row."""
        start = np.zeros((self.order, columns.shape[1]))
        if not self.order:
            return np.ascontiguousarray(columns), start
        filtered, state = lfilter([1.0], self.polynomial, columns[::-1], axis=0, zi=start)
        return np.ascontiguousarray(filtered[::-1]), state

    @cached_property
    def _tail(self) -> FloatArray:
        """(p, p), squares that a state still leaves in the endless past."""
        step = np.eye(self.order, k=1)
        step[:, 0] = self.coefficients
        total = np.zeros((self.order, self.order))
        total[0, 0] = 1.0
        for _ in range(DOUBLINGS):
            total, step = total + step.T @ total @ step, step @ step
        return total

    def _lags_from(self, products: FloatArray) -> FloatArray:
        """S (p + 1,) with Σ_j a_j S_|k-j| = products_k, the equations of Yule and Walker."""
        matrix, lags = np.zeros((self.order + 1, self.order + 1)), np.arange(self.order + 1)
        for j, a in enumerate(self.polynomial):
            np.add.at(matrix, (lags, np.abs(lags - j)), a)
        return np.asarray(np.linalg.solve(matrix, products), dtype=np.float64)


def raised(polynomial: FloatArray, reflection: float) -> FloatArray:
    """The polynomial of one order more."""
    longer = np.append(polynomial, 0.0)
    return np.asarray(longer + reflection * longer[::-1], dtype=np.float64)
