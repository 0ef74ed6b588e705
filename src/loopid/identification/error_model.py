"""The errors of one actuator: a model of them, corrected for what the fit has taken away.

Residuals are smaller, and follow one another less, than the errors do, because a fit takes up
whatever of the errors its regressor can express. A model of slow errors that is fitted to residuals
alone gives intervals that are too narrow; what was taken up has a known expectation and is added
back [Worsley2002].
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.identification.autoregression import Autoregression
from loopid.identification.burg import burg_covariances, run_lengths


class ErrorModel:
    """Autoregressive errors of one actuator, and how they add up in the estimates.

    Parameters
    ----------
    columns : FloatArray
        (N, n), regressor of the actuator, such that columns over all actuators are orthonormal.
    residual : FloatArray
        (N,), weighted as the columns are.
    used : BoolArray
        (N,).
    pieces : tuple of slice
        Rows of each stretch.
    """

    def __init__(
        self,
        columns: FloatArray,
        residual: FloatArray,
        used: BoolArray,
        pieces: tuple[slice, ...],
    ) -> None:
        present = np.ascontiguousarray(columns * used[:, None])
        self._parts = [present[piece] for piece in pieces]
        self._used = [used[piece].astype(np.float64)[:, None] for piece in pieces]
        self.samples = int(used.sum())
        self._observed = burg_covariances(residual, run_lengths(used, pieces))
        self._grams = [self._lagged_gram(k) for k in range(len(self._observed))]
        self._pairs = np.array([self._pairs_at(k) for k in range(len(self._observed))])
        freedom = max(self.samples - float(np.trace(self._grams[0])), 1.0)
        self.model = self._of(self._observed * self.samples / freedom)

    def sum_covariance(self) -> FloatArray:
        """Covariance (n, n) that the errors give the sums Σ_t x_t e_t."""
        return self.model.sum_covariance(self._parts)

    def correct(self, sums: FloatArray) -> None:
        """Add back what a fit takes up, expected under the present models of all actuators.

        Parameters
        ----------
        sums : FloatArray
            (n, n), covariance of the sums over all actuators.
        """
        taken = 2 * self.model.lagged_sums(self._parts)
        lags = slice(len(taken))
        taken -= np.array([np.sum(sums * gram) for gram in self._grams[lags]])
        covariances = self._observed[lags] + taken / np.maximum(self._pairs[lags], 1.0)
        if covariances[0] > 0:
            self.model = self._of(covariances)

    def _of(self, covariances: FloatArray) -> Autoregression:
        # Errors slower than a log is long cannot be told from an offset.
        return Autoregression.of_covariances(covariances, limit=1 - 1 / max(self.samples, 2))

    def effective_samples(self) -> float:
        """How many independent samples would tell the mean error as well."""
        spread = float(self.model.sum_covariance(self._used)[0, 0])
        if not spread > 0:
            return float(self.samples)
        variance = float(self.model.covariances()[0])
        return min(self.samples**2 * variance / spread, float(self.samples))

    def _lagged_gram(self, lag: int) -> FloatArray:
        grams = [part[: max(len(part) - lag, 0)].T @ part[lag:] for part in self._parts]
        return np.asarray(np.sum(grams, axis=0), dtype=np.float64)

    def _pairs_at(self, lag: int) -> float:
        return sum(float(np.sum(u[: max(len(u) - lag, 0)] * u[lag:])) for u in self._used)
