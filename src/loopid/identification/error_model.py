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
from loopid.identification.lagged import lagged_grams, past_sums

# Parts of a correction that are tried, and the part of the innovations' variance that must stay.
DAMPING = (1.0, 0.5, 0.25, 0.125, 0.0)
KEPT_INNOVATION = 0.5


class ErrorModel:
    """Autoregressive errors of one actuator, and how they add up in the estimates.

    Parameters
    ----------
    columns : FloatArray
        (N, n), regressor of the actuator, such that columns over all actuators are orthonormal;
        zero where a sample is not used.
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
        self._columns, self._used, self._pieces = columns, used, pieces
        self._observed = burg_covariances(residual, run_lengths(used, pieces))
        self._observed[0] = max(self._observed[0], least**2)
        order = len(self._observed) - 1
        self._grams, pairs = lagged_grams(columns, pieces, order), _pairs(used, pieces, order)
        self._pairs, self.samples = pairs, int(pairs[0])
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
        left = np.einsum("ij,kij->k", sums, self._grams[: len(self._shared)])
        return np.asarray(self._shared - left, dtype=np.float64)

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
        spread = self.model.sum_variance(self._used, self._pieces)
        variance = float(self.model.covariances[0])
        return min(self.samples**2 * variance / spread, float(self.samples))

    def _adopt(self, model: Autoregression) -> None:
        """Take a model, and what it makes of the sums.

        ``_shared`` is Σ_t u_t (Ω x)_t · (x_{t+k} + x_{t-k}), u_t = 1 where a sample is used. Of
        Ω X, the part from the past is filtered forwards, and that from the future backwards.
        """
        self.model = model
        variance, grams = float(model.covariances[0]), self._grams[: model.order + 1]
        traces = np.trace(grams, axis1=1, axis2=2)
        if not model.order:
            self.sums, self._shared = variance * grams[0], 2 * variance * traces
            return
        count = len(self._columns)
        turned = tuple(slice(count - p.stop, count - p.start) for p in self._pieces[::-1])
        past, ahead = past_sums(model, self._columns, self._used, self._pieces)
        _, behind = past_sums(model, self._columns[::-1], self._used[::-1], turned)
        self.sums = past + past.T - variance * grams[0]
        self._shared = ahead + behind - 2 * variance * traces


def _pairs(used: BoolArray, pieces: tuple[slice, ...], order: int) -> FloatArray:
    """How many pairs (order + 1,) of used samples are so far apart."""
    return lagged_grams(used[:, None], pieces, order)[:, 0, 0]
