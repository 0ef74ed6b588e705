"""Zero-phase low-pass filtering and differentiation of evenly sampled signals.

A Butterworth filter run forwards and backwards leaves no delay; positions filtered like this are
differentiated by central differences, and forces are filtered alike, so that both sides of the
equations lose the same frequencies [Gautier1997]. Long signals are filtered block by block, each
block taking over the filter's state from the one before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked, checked_fields
from loopid.arrays import FloatArray, finite
from loopid.errors import DataError, OptionError
from loopid.scratch import Spool, finite_rows, row_blocks

# Periods of the cut-off frequency for which the ends are continued, per order, lest they ring: the
# slowest mode of a pass falls to a millionth meanwhile. The first order takes what the second does.
PADDING = 1.5


@checked_fields
@dataclass(frozen=True)
class LowPass:
    """A Butterworth low-pass filter, run forwards and backwards.

    Attributes
    ----------
    cutoff : float
        In Hz; each of the two passes is at half its power there.
    order : int
        Of each pass.
    """

    cutoff: float
    order: int = 2

    def __post_init__(self) -> None:
        if not 0 < self.cutoff < np.inf:
            raise OptionError(f"the cut-off frequency must be positive, not {self.cutoff} Hz")
        if self.order < 1:
            raise OptionError(f"the order of a filter must be at least 1, not {self.order}")

    def least_samples(self, rate: float) -> int:
        """Fewest samples at a rate (Hz) that can be filtered."""
        return self._padding(rate) + 1

    @checked
    def apply(self, values: FloatArray, rate: float) -> FloatArray:
        """Filter signals (N, ...) along their first axis, sampled at a rate in Hz.

        Raises
        ------
        OptionError
            When the rate is not positive, or the cut-off not below half of it.
        DataError
            When there are fewer than ``least_samples``.
        """
        signal = _signal(finite_rows(values, "signal"))
        if not 0 < rate < np.inf:
            raise OptionError(f"the sample rate must be positive, not {rate} Hz")
        if not self.cutoff < 0.5 * rate:
            raise OptionError(
                f"the cut-off frequency must be below half the sample rate, {0.5 * rate:g} Hz, "
                f"not {self.cutoff:g} Hz"
            )
        if len(signal) < self.least_samples(rate):
            raise DataError(
                f"{len(signal)} samples are too few to filter at {self.cutoff:g} Hz: it takes "
                f"{self.least_samples(rate)} at {rate:g} Hz"
            )
        # Slow to import, and only needed for logs.
        from scipy.signal import butter

        sections = butter(self.order, self.cutoff, fs=rate, output="sos")
        padding = self._padding(rate)
        once = _filtered(sections, _extended(signal, padding))[::-1]
        twice = _filtered(sections, (once[rows] for rows in row_blocks(len(once))))[::-1]
        return twice[padding : len(twice) - padding]

    def _padding(self, rate: float) -> int:
        return int(np.ceil(PADDING * max(self.order, 2) * rate / self.cutoff))


def _signal(values: FloatArray) -> FloatArray:
    if values.ndim == 0:
        raise DataError("a signal must have an axis of samples, but this is a single number")
    return values


def _extended(signal: FloatArray, padding: int) -> Iterator[FloatArray]:
    """Blocks of a signal (N, ...), continued at both ends by itself turned about them."""
    yield 2 * signal[0] - signal[padding:0:-1]
    for rows in row_blocks(len(signal)):
        yield signal[rows]
    yield 2 * signal[-1] - signal[-2 : -padding - 2 : -1]


def _filtered(sections: FloatArray, blocks: Iterator[FloatArray]) -> FloatArray:
    """One pass over blocks of a signal, from the state that its first value would have left."""
    from scipy.signal import sosfilt, sosfilt_zi

    spool, state = Spool(), None
    for block in blocks:
        columns = block.reshape(len(block), -1)
        if state is None:
            state = sosfilt_zi(sections)[:, :, None] * columns[0]
        filtered, state = sosfilt(sections, columns, axis=0, zi=state)
        spool.append(filtered.reshape(block.shape))
    return np.asarray(spool.array(), dtype=np.float64)


@checked
def differentiate(values: FloatArray, rate: float) -> FloatArray:
    """Derivatives by time (N, ...) of evenly sampled signals, by central differences.

    Raises
    ------
    OptionError
        When the rate is not positive.
    DataError
        When there are fewer than three samples.
    """
    signal = _signal(finite(values, "signal"))
    if not 0 < rate < np.inf:
        raise OptionError(f"the rate must be positive, not {rate} Hz")
    if len(signal) < 3:
        raise DataError(f"{len(signal)} samples are too few to differentiate: it takes 3")
    return np.asarray(np.gradient(signal, 1.0 / rate, axis=0, edge_order=2), dtype=np.float64)
