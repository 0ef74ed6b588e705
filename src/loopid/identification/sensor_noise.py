"""Noise of the sensors of force, by what is above half the Nyquist frequency.

The motion of a robot ends far below. What is left there is the sensors' own, if it is white. Then
it is as strong below the cut-off. Where a controller has filtered the forces their spectrum falls
before the Nyquist frequency. The noise below the cut-off is then undetermined.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from loopid.arguments import FloatArray
from loopid.logs.recording import Recording

LEAST_SAMPLES = 256  # of a segment: some 30 frequencies in each band
BANDS = 0.25, 0.5, 0.75, 1.0  # of the Nyquist frequency
# Part of the power in the middle band that the upper one has at least of white noise, and in the
# lower band: there some of the motion may be left, and jumps of friction fall by more.
FALLS, JUMPS = 0.7, 0.4


def sensor_noise(recording: Recording) -> FloatArray:
    """Root mean squares (dof,) in N or N m of the sensors' noise below the cut-off.

    NaN where it is undetermined: without a log, in a short one, or of filtered forces.
    """
    log, found = recording.log, np.full(len(recording.actuators), np.nan)
    if log is None:
        return found
    parts = [part for part in log.parts() if len(log.time[part]) >= LEAST_SAMPLES]
    if not parts:
        return found
    powers = [_powers(log.force[part], log.rate(part)) for part in parts]
    counts = [len(log.time[part]) for part in parts]
    low, middle, high = np.average(powers, axis=0, weights=counts)
    passed = np.mean([_passed(recording, log.rate(part)) for part in parts])
    with np.errstate(divide="ignore", invalid="ignore"):
        white = (high >= FALLS * middle) & (high >= JUMPS * low)
        size = np.where(white, np.sqrt((middle + high) / 2 * passed), np.nan)
    for k, motor in enumerate(recording.actuators):
        if motor in log.joints:
            found[k] = size[log.joints.index(motor)]
    return np.asarray(np.where(found > 0, found, np.nan))


def _powers(force: FloatArray, rate: float) -> FloatArray:
    """Power per Hz (3, m) of forces (N, m) in the bands.

    Medians, which lines such as of a mains hum do not move, as means of normal noise.
    """
    window = np.hanning(len(force))
    spectrum = np.fft.rfft(force * window[:, None], axis=0)
    power = 2 * np.abs(spectrum) ** 2 / (rate * (window**2).sum())
    edges = [int(part * (len(power) - 1)) for part in BANDS]
    bands = [np.median(power[low:high], axis=0) for low, high in pairwise(edges)]
    return np.asarray(np.array(bands) / np.log(2))


def _passed(recording: Recording, rate: float) -> float:
    """The band in Hz of white noise that is as strong as what the filter leaves."""
    if recording.cutoff is None or recording.filter is None:
        return rate / 2
    frequencies = np.linspace(0.0, rate / 2, 2000)
    left = 1 / (1 + (frequencies / recording.cutoff) ** (2 * recording.filter.order)) ** 2
    return float(left.mean() * rate / 2)
