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

# Parts of a correction that are tried, and the part of the innovations' variance that must stay.
DAMPING = (1.0, 0.5, 0.25, 0.125, 0.0)
KEPT_INNOVATION = 0.5


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
    least : float
        Deviation, weighted as the residual is, that independent errors have at least.

    Attributes
    ----------
    samples : int
    model : Autoregression
    sums : FloatArray
        (n, n), covariance that the errors give the sums Σ_t x_t e_t.
    """

    def __init__(
        self,
        columns: FloatArray,
        residual: FloatArray,
        used: BoolArray,
        pieces: tuple[slice, ...],
        least: float = 0.0,
    ) -> None:
        present = columns * used[:, None]
        self._parts = [present[piece] for piece in pieces]
        self._used = [used[piece].astype(np.float64)[:, None] for piece in pieces]
        self.samples = int(used.sum())
        self._observed = burg_covariances(residual, run_lengths(used, pieces))
        self._observed[0] = max(self._observed[0], least**2)
        lags = range(len(self._observed))
        self._pairs = np.array([_lagged(self._used, self._used, k)[0, 0] for k in lags])
        self._grams = [_lagged(self._parts, self._parts, k) for k in lags]
        freedom = max(self.samples - float(np.trace(self._grams[0])), 1.0)
        start = Autoregression.of_covariances(self._observed * self.samples / freedom)
        self._least_innovation = KEPT_INNOVATION * start.variance * freedom / self.samples
        self._adopt(start)

    def taken_up(self, sums: FloatArray) -> FloatArray:
        """By how much a fit lowers Σ_t e_t e_{t+k} over used pairs, on average; (p + 1,).

        Parameters
        ----------
        sums : FloatArray
            (n, n), as ``sums``, over all actuators.
        """
        left = [float(np.sum(sums * gram)) for gram in self._grams[: len(self._shared)]]
        return np.asarray(self._shared - np.array(left), dtype=np.float64)

    def correct(self, sums: FloatArray) -> None:
        """Make the model again, with what the fit takes up under the present models added back.

        A fit takes up what is smooth, so the innovations stay what they are. Where the whole
        correction would shrink them, it asks for errors that cannot be, and is damped.
        """
        taken = self.taken_up(sums)
        lags = slice(len(taken))
        correction = taken / np.maximum(self._pairs[lags], 1.0)
        for part in DAMPING:
            covariances = self._observed[lags] + part * correction
            model = Autoregression.of_covariances(covariances)
            if model.order == len(covariances) - 1 and model.variance >= self._least_innovation:
                return self._adopt(model)
        return None

    def effective_samples(self) -> float:
        """How many independent samples would tell the mean error as well."""
        if not self.model.order:
            return float(self.samples)
        spread = sum(float(np.vdot(u, self.model.covariance_times(u))) for u in self._used)
        variance = float(self.model.covariances[0])
        return min(self.samples**2 * variance / spread, float(self.samples))

    def _adopt(self, model: Autoregression) -> None:
        self.model = model
        spread = [self.model.covariance_times(part) for part in self._parts]
        self.sums = _lagged(self._parts, spread, 0)
        present = [part * u for part, u in zip(spread, self._used, strict=True)]
        self._shared = np.array(
            [
                _lagged_product(self._parts, present, k) + _lagged_product(present, self._parts, k)
                for k in range(self.model.order + 1)
            ]
        )


def _lagged(one: list[FloatArray], other: list[FloatArray], lag: int) -> FloatArray:
    """Σ_t x_t y_{t+k}ᵀ (n, n) over parts of rows x and y (L, n)."""
    parts = zip(one, other, strict=True)
    grams = [x[: max(len(x) - lag, 0)].T @ y[lag:] for x, y in parts]
    return np.asarray(np.sum(grams, axis=0), dtype=np.float64)


def _lagged_product(one: list[FloatArray], other: list[FloatArray], lag: int) -> float:
    """Σ_t x_t·y_{t+k}, the trace of the same."""
    parts = zip(one, other, strict=True)
    return float(sum(np.vdot(x[: max(len(x) - lag, 0)], y[lag:]) for x, y in parts))
