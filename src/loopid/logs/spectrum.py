"""The band of a motion and the noise of its positions, as a log shows them, and a cut-off for both.

Second differences of measured positions are accelerations and noise. White noise of positions,
such as that of encoder steps, grows there with the fourth power of the frequency; the upper half
of the frequencies, where robots do not move, tells its level.
"""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray
from loopid.logs.log import Log
from loopid.records import record

# Part of the power of the velocities that is within the band of a motion.
BAND_POWER = 0.999
# The cut-off, in bands: it changes what is within the band by less than 1e-5, ...
WIDTH = 20.0
# ... or lower, where noise would be more than this part of the power of the filtered accelerations,
# but not below so many bands.
NOISE_POWER, LEAST_WIDTH = 1e-5, 5.0
# Samples a period of the cut-off, at the rate of the log.
LEAST_PERIOD = 5.0
# Frequencies are averaged, so many of them or so wide a part; where the average exceeds the noise
# so many times, the robot moves.
AVERAGED, RELATIVE_WIDTH, ABOVE_NOISE = 8, 0.1, 3.0
# Samples that tell a spectrum; of fewer, the cut-off is this part of the rate.
LEAST_COUNT, SHORT_CUTOFF = 62, 0.05
# ∫ x^4 / (1 + x^4)² dx from 0 on: what a filter of second order, run twice, leaves of noise.
PASSED = np.pi / (8 * np.sqrt(2))


@record
class MotionSpectrum:
    """Spectrum of accelerations, each motor's in units of its power, on average of those that move.

    Attributes
    ----------
    frequency : FloatArray
        (F,) in Hz, ascending.
    density, noise : FloatArray
        (F,) in 1/Hz, of motion with noise, and of noise alone.
    band : float
        In Hz, below which nearly all of the motion is; 0 without motion.
    cutoff : float
        In Hz, of the filter that suits.
    """

    frequency: FloatArray
    density: FloatArray
    noise: FloatArray
    band: float
    cutoff: float


def motion_spectrum(log: Log) -> MotionSpectrum:
    """Spectrum of the longest stretch of a log, and the cut-off that it asks for.

    That is 20 times the band of the motion; less, down to five times, where noise would exceed
    1e-5 of the power of the filtered accelerations; and no more than a fifth of the rate. Fewer
    than 64 samples tell none: the cut-off is a twentieth of the rate.
    """
    part = max(log.parts(), key=lambda part: part.stop - part.start)
    rate, count = log.rate(part), part.stop - part.start - 2
    if count < LEAST_COUNT:
        nothing = np.zeros(0)
        return MotionSpectrum(nothing, nothing, nothing, 0.0, SHORT_CUTOFF * rate or 1.0)
    frequencies = np.fft.rfftfreq(count, 1 / rate).astype(np.float64)
    edges = [0]
    while edges[-1] < len(frequencies):
        edges.append(edges[-1] + max(AVERAGED, int(RELATIVE_WIDTH * edges[-1])))
    sizes = np.diff([*edges[:-1], len(frequencies)])

    def averaged(values: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(values, edges[:-1]) / sizes)

    # How second differences amplify white noise of positions.
    shape = averaged((2 * rate * np.sin(np.pi * frequencies / rate)) ** 4)
    frequency, widths = averaged(frequencies), sizes * rate / count
    window = np.hanning(count + 2)[1:-1]
    power = rate * float((window**2).sum())
    total, level, limit = np.zeros(len(frequency)), 0.0, rate / LEAST_PERIOD
    for k in range(len(log.joints)):
        acceleration = np.diff(log.position[part, k], 2)
        acceleration *= rate**2 * window
        amplitude = np.fft.rfft(acceleration)
        density = averaged(amplitude.real**2 + amplitude.imag**2) * 2 / power
        floor = float(np.median((density / shape)[frequency >= rate / 4]))
        motion = np.where(density > ABOVE_NOISE * floor * shape, density - floor * shape, 0.0)
        size = float(motion @ widths)
        if size > 0:
            total, level = total + density / size, level + floor / size
    noise = level * shape
    motion = np.where(total > ABOVE_NOISE * noise, total - noise, 0.0)
    velocity = np.cumsum(motion * widths / frequency**2)
    if not velocity[-1] > 0:
        return MotionSpectrum(frequency, total, noise, 0.0, limit)
    band = float(frequency[np.searchsorted(velocity, BAND_POWER * velocity[-1])])
    passed = PASSED * (2 * np.pi) ** 4 * level / (motion @ widths)
    quiet = (NOISE_POWER / passed) ** 0.2 if passed > 0 else np.inf
    cutoff = min(max(min(WIDTH * band, quiet), LEAST_WIDTH * band), limit)
    return MotionSpectrum(frequency, total, noise, band, float(cutoff))
