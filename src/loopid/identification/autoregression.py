"""Autoregressive errors, and what they do to sums over them [Percival1993]."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arrays import FloatArray

# Keeps errors that hardly return to zero from never returning.
LARGEST_REFLECTION = 0.9999


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
    def of_covariances(cls, covariances: FloatArray) -> Autoregression:
        """The model with autocovariances (p + 1,) at lags 0 to p, by Levinson's recursion.

        No process has covariances that ask for a reflection coefficient of 1 or more; where they
        do, the model ends at that lag with the largest allowed.
        """
        polynomial, variance = np.ones(1), float(covariances[0])
        for k in range(1, len(covariances)):
            asked = -float(polynomial @ covariances[k:0:-1]) / variance
            reflection = float(np.clip(asked, -LARGEST_REFLECTION, LARGEST_REFLECTION))
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

    @cached_property
    def covariances(self) -> FloatArray:
        """Autocovariances (p + 1,) at lags 0 to p, by the equations of Yule and Walker."""
        matrix, lags = np.zeros((self.order + 1, self.order + 1)), np.arange(self.order + 1)
        for j, a in enumerate(self.polynomial):
            np.add.at(matrix, (lags, np.abs(lags - j)), a)
        right = np.append(self.variance, np.zeros(self.order))
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)

    def covariance_times(self, rows: FloatArray) -> FloatArray:
        """Ω X of evenly spaced rows X (L, m), with Ω (L, L) the covariance of as many errors.

        Autocovariances follow the recursion of the process, so a filter N / A with as many
        coefficients has them as its impulse response: Ω X is X filtered forwards and backwards in
        time, less what both count.
        """
        if not self.order:
            return self.variance * rows
        # Slow to import, and only needed where errors are correlated.
        from scipy.signal import lfilter

        numerator = np.convolve(self.polynomial, self.covariances)[: max(self.order, 1)]
        past = lfilter(numerator, self.polynomial, rows, axis=0)
        future = lfilter(numerator, self.polynomial, rows[::-1], axis=0)[::-1]
        return np.asarray(past + future - self.covariances[0] * rows, dtype=np.float64)


def raised(polynomial: FloatArray, reflection: float) -> FloatArray:
    """The polynomial of one order more."""
    longer = np.append(polynomial, 0.0)
    return np.asarray(longer + reflection * longer[::-1], dtype=np.float64)
