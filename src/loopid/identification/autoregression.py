"""Autoregressive errors, and what they do to sums over them [Percival1993]."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.scratch import row_blocks

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

    def past_part(
        self, rows: FloatArray, state: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """What rows X (L, m) up to each one give to Ω X, and the state for the rows that follow.

        Ω is the covariance of evenly spaced errors, one a row. Autocovariances follow the recursion
        of the process, so a filter N / A with as many coefficients has them as its impulse
        response: Ω X is X filtered forwards and backwards in time, less γ_0 X, which both count.
        """
        # Slow to import, and only needed where errors are correlated.
        from scipy.signal import lfilter

        if state is None:
            state = np.zeros((self.order, rows.shape[1]))
        numerator = np.convolve(self.polynomial, self.covariances)[: max(self.order, 1)]
        past, state = lfilter(numerator, self.polynomial, rows, axis=0, zi=state)
        return np.asarray(past, dtype=np.float64), np.asarray(state, dtype=np.float64)

    def sum_variance(self, present: BoolArray, pieces: tuple[slice, ...]) -> float:
        """Variance of the sum of errors over the samples (N,) that are present.

        Parameters
        ----------
        pieces : tuple of slice
            Rows of each evenly sampled stretch; errors of different ones are independent.
        """
        count = total = 0.0
        for piece in pieces:
            state = None
            for rows in row_blocks(piece):
                ones = np.asarray(present[rows], dtype=np.float64)[:, None]
                past, state = self.past_part(ones, state)
                count, total = count + float(ones.sum()), total + float(np.vdot(ones, past))
        return 2 * total - float(self.covariances[0]) * count


def raised(polynomial: FloatArray, reflection: float) -> FloatArray:
    """The polynomial of one order more."""
    longer = np.append(polynomial, 0.0)
    return np.asarray(longer + reflection * longer[::-1], dtype=np.float64)
