"""Zero-phase low-pass filtering and differentiation of evenly sampled signals.

A Butterworth filter run forwards and backwards leaves no delay. Each frequency keeps its phase, so
that it is applied to the spectrum. Positions filtered like this are differentiated by central
differences of fourth order. Forces are filtered alike, so that both sides of the equations lose the
same frequencies [Gautier1997].
"""

from __future__ import annotations

from bisect import bisect_left
from typing import Annotated

import numpy as np
from pydantic import Field

from loopid.arguments import FloatArray, Positive, checked, finite
from loopid.errors import DataError, OptionError
from loopid.records import derived, record

# Periods of the cut-off frequency for which the ends are continued, per order, lest they ring: the
# slowest mode of a pass falls to a millionth meanwhile. The first order takes what the second does.
PADDING = 1.5
AT_ONCE = 500_000  # numbers that are transformed at once: long logs have many columns
# Products of twos, threes and fives, up to 4e9 all of them: no memory holds longer transforms.
FAST: list[int] = sorted(
    2**i * 3**j * 5**k for i in range(33) for j in range(21) for k in range(14)
)


@record(checked=True)
class LowPass:
    """A Butterworth low-pass filter, run forwards and backwards.

    Attributes
    ----------
    cutoff : float
        In Hz; each of the two passes is at half its power there.
    order : int
        Of each pass.

    Examples
    --------
    >>> import numpy as np
    >>> import loopid
    >>> time = np.arange(0, 4, 0.01)
    >>> slow, fast = np.sin(2 * np.pi * 0.5 * time), np.sin(2 * np.pi * 25 * time)
    >>> filtered = loopid.motion.LowPass(5.0).apply(slow + fast, rate=100)
    >>> bool(abs(filtered - slow)[50:-50].max() < 0.01)
    True
    """

    cutoff: Positive
    order: Annotated[int, Field(ge=1)] = 2

    def least_samples(self, rate: float) -> int:
        """Fewest samples at a rate (Hz) that can be filtered."""
        return int(np.ceil(PADDING * max(self.order, 2) * rate / self.cutoff)) + 1

    def apply(self, values: FloatArray, rate: Positive) -> FloatArray:
        """Filter signals (N, ...) along their first axis, sampled at a rate in Hz.

        Raises
        ------
        OptionError
            When the rate is not positive, or the cut-off not below half of it.
        DataError
            When there are fewer than ``least_samples``.
        """
        signal = _signal(values)
        padding = self.least_samples(rate) - 1
        if not self.cutoff < 0.5 * rate:
            raise OptionError(
                f"the cut-off frequency must be below half the sample rate, {0.5 * rate:g} Hz, "
                f"not {self.cutoff:g} Hz"
            )
        if len(signal) <= padding:
            raise DataError(
                f"{len(signal)} samples are too few to filter at {self.cutoff:g} Hz: it takes "
                f"{padding + 1} at {rate:g} Hz"
            )
        count = len(signal) + 2 * padding
        size = fast_length(count)
        gains, line = _gains(self, size, rate), np.linspace(0.0, 1.0, count)
        columns = signal.reshape(len(signal), -1)
        found, step = np.empty_like(columns), max(AT_ONCE // count, 1)
        for start in range(0, columns.shape[1], step):
            some = slice(start, start + step)
            own = np.ascontiguousarray(columns[:, some].T)
            # Continued by its own mirror image about each end, in time and in value.
            first, last = own[:, padding:0:-1], own[:, -2 : -padding - 2 : -1]
            ends = 2 * own[:, :1] - first, own, 2 * own[:, -1:] - last
            longer = np.concatenate(ends, axis=1)
            # A line passes the filter; without that between its ends the signal is periodic.
            straight = longer[:, :1] + (longer[:, -1:] - longer[:, :1]) * line
            bent = np.fft.irfft(gains * np.fft.rfft(longer - straight, size), size)
            found[:, some] = (bent[:, :count] + straight)[:, padding:-padding].T
        return found.reshape(signal.shape)


@derived
def _gains(lowpass: LowPass, size: int, rate: float) -> FloatArray:
    """Of the frequencies of a spectrum, by both passes.

    tan(π f) stands for f, as by the bilinear transform [Oppenheim2010, ch. 7].
    """
    cutoff = np.tan(np.pi * lowpass.cutoff / rate)
    bent = np.tan(np.pi * np.arange(size // 2 + 1) / size) / cutoff
    with np.errstate(over="ignore"):  # nothing is left there
        return np.asarray(1.0 / (1.0 + np.square(bent) ** lowpass.order))


def fast_length(count: int) -> int:
    """The least length from a count on that is a product of twos, threes and fives, for FFTs."""
    return FAST[bisect_left(FAST, count)]


@checked
def differentiate(values: FloatArray, rate: Positive) -> FloatArray:
    """Derivatives by time (N, ...) of evenly sampled signals.

    Central differences of fourth order [Fornberg1988], of second order in the first and the last
    two samples. Of a frequency ω at steps h, (ωh)⁴/30 is lost.
    """
    signal = _signal(values)
    if len(signal) < 3:
        raise DataError(f"{len(signal)} samples are too few to differentiate: it takes 3")
    found = np.gradient(signal, 1.0 / rate, axis=0, edge_order=2)
    near, far = signal[3:-1] - signal[1:-3], signal[4:] - signal[:-4]
    found[2:-2] = (8 * near - far) * (rate / 12)
    return np.asarray(found, dtype=np.float64)


def _signal(values: FloatArray) -> FloatArray:
    signal = finite(values, "signal")
    if signal.ndim == 0:
        raise DataError("a signal must have an axis of samples, but this is a single number")
    return signal
