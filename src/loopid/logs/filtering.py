"""Filtered positions and forces with the derivatives of the positions, stretch by stretch."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import checked
from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import LogError
from loopid.logs.log import Log
from loopid.logs.streams import Dropped
from loopid.robot import Mechanism
from loopid.scratch import empty_columns, mapped_rows, release_pages
from loopid.trajectories import LowPass, differentiate

# The default cut-off frequency, as a fraction of the sample rate.
DEFAULT_CUTOFF = 0.05
# Samples are kept at no less than this many times the cut-off frequency.
LEAST_OVERSAMPLING = 5.0
LEAST_SAMPLES = 3  # what it takes to differentiate
ROUNDING = 1e-3  # relative, of measured rates
# Periods of the cut-off frequency, for a filter of second order, after which 1 % is left of what a
# single sample or the end of a stretch does to the filtered signal.
REACH = 1.0
# Forces within this fraction of the saturation are saturated.
SATURATION_TOLERANCE = 0.01
# Standing: at most this fraction of the 99th percentile of a motor's own speed,
IDLE_FRACTION = 0.05
# or this fraction of that of the fastest motor of its kind: an encoder that only dithers.
DITHER_FRACTION = 0.01


class Filtered(NamedTuple):
    """Samples that are kept after filtering."""

    time: FloatArray  # (N,) in s
    position: FloatArray  # (N, m)
    velocity: FloatArray  # (N, m)
    acceleration: FloatArray  # (N, m)
    force: FloatArray  # (N, m)
    saturated: BoolArray  # (N, m)
    stretches: IntArray  # (N,)

    def select(self, flags: BoolArray) -> Filtered:
        """The samples (N,) that are flagged, in order."""

        def chosen(signal: NDArray[Any]) -> NDArray[Any]:
            return mapped_rows(lambda rows: signal[rows][flags[rows]], len(flags))

        return Filtered(*map(chosen, self))


@checked
def default_lowpass(log: Log) -> LowPass:
    """A filter at ``DEFAULT_CUTOFF`` of the log's rate."""
    return LowPass(DEFAULT_CUTOFF * max(log.rate(part) for part in log.parts()))


def filter_log(
    log: Log, lowpass: LowPass | None, saturation: FloatArray, decimate: bool, trim: bool
) -> tuple[Filtered, tuple[Dropped, ...]]:
    """Filter, differentiate twice, and then keep as many samples as the cut-off calls for.

    The saturation (m,) is infinite for drives without; ``decimate`` leaves out samples, and
    ``trim`` the ends of the stretches.
    """
    from scipy.ndimage import binary_dilation  # here, as it takes a while to import

    def smooth(signal: FloatArray) -> FloatArray:
        return signal if lowpass is None else lowpass.apply(signal, rate)

    dropped, chosen = [], []
    for part in log.parts():
        rate, time = log.rate(part), log.time[part]
        least = 0 if lowpass is None else lowpass.least_samples(rate)
        if len(time) < max(least, LEAST_SAMPLES):
            dropped.append(Dropped.at("stretch too short to filter", time))
            continue
        reach, step = 0, 1
        if lowpass is not None:
            reach = int(np.ceil(REACH * max(lowpass.order, 2) / 2 * rate / lowpass.cutoff))
            # Rates are measured: one a little short of a whole number of times is meant to be it.
            step = max(int((1 + ROUNDING) * rate / (LEAST_OVERSAMPLING * lowpass.cutoff)), 1)
        # Accelerations are wrong where a filter does not know what comes next.
        end = reach if trim else 0
        if end:
            dropped.append(Dropped.at("end of a stretch", np.append(time[:end], time[-end:])))
        rows = np.arange(part.start + end, part.stop - end, step if decimate else 1)
        chosen.append((part, reach, rows))
    if not chosen:
        longest = max(one.count for one in dropped)
        raise LogError(
            f"{log.name}: all stretches without gaps are too short to filter, the longest has "
            f"{longest} samples"
        )
    samples = np.concatenate([rows for _, _, rows in chosen])
    shape = len(samples), len(log.joints)
    saturated = np.empty(shape, dtype=bool)
    position, velocity, acceleration, force = (empty_columns(*shape) for _ in range(4))
    done = 0
    for part, reach, rows in chosen:
        rate, inner, place = log.rate(part), rows - part.start, slice(done, done + len(rows))
        done += len(rows)
        for k, limit in enumerate(saturation):
            release_pages()
            raw, at = log.force[part, k], (place, k)
            near_limit = np.abs(raw) >= limit * (1.0 - SATURATION_TOLERANCE)
            saturated[at] = binary_dilation(near_limit, np.ones(2 * reach + 1, dtype=bool))[inner]
            force[at] = smooth(raw)[inner]
            signal = smooth(log.position[part, k])
            position[at] = signal[inner]
            signal = differentiate(signal, rate)
            velocity[at] = signal[inner]
            acceleration[at] = differentiate(signal, rate)[inner]
    tables = position, velocity, acceleration, force, saturated
    filtered = Filtered(log.time[samples], *tables, log.stretches[samples])
    return filtered, tuple(dropped)


def idle_speeds(mechanism: Mechanism, velocity: FloatArray) -> FloatArray:
    """Speeds (m,) at or below which motors with velocities (N, m) count as standing."""
    usual = np.array([np.percentile(np.abs(column), 99) for column in velocity.T])
    straight = np.isin(mechanism.velocity_indices(mechanism.actuated), mechanism.prismatic)
    fastest = np.empty_like(usual)
    for kind in (straight, ~straight):
        fastest[kind] = usual[kind].max(initial=0.0)
    return np.maximum(IDLE_FRACTION * usual, DITHER_FRACTION * fastest)


def saturation_of(mechanism: Mechanism, force: FloatArray) -> FloatArray:
    """Forces (m,) from which drives saturate by the effort limits of the robot file.

    A limit that the measured forces (N, m) exceed is not what they saturate at; zero is how
    exporters write that there is none.
    """
    limits = mechanism.model.upperEffortLimit[mechanism.velocity_indices(mechanism.actuated)]
    largest = np.array([max(column.max(), -column.min()) for column in force.T])
    exceeded = largest > limits * (1.0 + SATURATION_TOLERANCE)
    return np.where((limits > 0) & ~exceeded, limits, np.inf)
