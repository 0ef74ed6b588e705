"""Filtered positions and forces with the derivatives of the positions, stretch by stretch."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import LogError
from loopid.logs.log import Log
from loopid.logs.masks import filter_reach, saturated
from loopid.logs.recording import Dropped
from loopid.trajectories import JointMotion, LowPass, differentiate

# The default cut-off frequency, as a fraction of the sample rate.
DEFAULT_CUTOFF = 0.05
# Samples are kept at no less than this many times the cut-off frequency.
LEAST_OVERSAMPLING = 5.0
LEAST_SAMPLES = 3  # what it takes to differentiate
ROUNDING = 1e-3  # relative, of measured rates


@dataclass(frozen=True)
class Smooth:
    """Samples that are kept after filtering.

    Attributes
    ----------
    time : FloatArray
        (N,) in s.
    position, velocity, acceleration, force : FloatArray
        (N, dof).
    saturated : BoolArray
        (N, dof).
    stretches : IntArray
        (N,).
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    force: FloatArray
    saturated: BoolArray
    stretches: IntArray

    def select(self, rows: BoolArray) -> Smooth:
        """Some of the samples (N,), in order."""
        return Smooth(*(getattr(self, field.name)[rows] for field in fields(self)))

    def motion(
        self, configurations: FloatArray, singularity: FloatArray, columns: list[int]
    ) -> JointMotion:
        """The motion of some columns, with configurations (N, nq) and singularity measures (N,)."""
        velocity, acceleration = self.velocity[:, columns], self.acceleration[:, columns]
        return JointMotion(self.time, configurations, velocity, acceleration, singularity)


def default_lowpass(log: Log) -> LowPass:
    """A filter at ``DEFAULT_CUTOFF`` of the log's rate."""
    return LowPass(DEFAULT_CUTOFF * max(log.rate(part) for part in log.parts()))


def smooth(
    log: Log, lowpass: LowPass | None, saturation: FloatArray, decimate: bool, trim: bool
) -> tuple[Smooth, tuple[Dropped, ...]]:
    """Filter, differentiate twice, and then keep as many samples as the cut-off calls for.

    Parameters
    ----------
    lowpass : LowPass or None
        None to differentiate as it is.
    saturation : FloatArray
        (dof,), infinite for drives without.
    decimate : bool
        Whether to leave samples out.
    trim : bool
        Whether to leave out the ends of the stretches.

    Raises
    ------
    LogError
        When all stretches are too short.
    """
    parts: list[tuple[FloatArray | BoolArray | IntArray, ...]] = []
    dropped = []
    for part in log.parts():
        rate, time = log.rate(part), log.time[part]
        least = LEAST_SAMPLES if lowpass is None or rate == 0 else lowpass.least_samples(rate)
        if len(time) < max(least, LEAST_SAMPLES):
            dropped.append(_dropped("stretch too short to filter", time))
            continue
        columns = _smooth_part(log, part, lowpass, saturation)
        # Accelerations are wrong where a filter does not know what comes next.
        end = filter_reach(lowpass, rate) if trim else 0
        if end:
            dropped.append(_dropped("end of a stretch", np.append(time[:end], time[-end:])))
        step = _stride(rate, lowpass) if decimate else 1
        parts.append(tuple(column[end : len(time) - end : step] for column in columns))
    if not parts:
        longest = max(one.count for one in dropped)
        raise LogError(
            f"{log.name}: all stretches without gaps are too short to filter, the longest has "
            f"{longest} samples"
        )
    return Smooth(*(np.concatenate(columns) for columns in zip(*parts, strict=True))), (*dropped,)


def _smooth_part(
    log: Log, part: slice, lowpass: LowPass | None, saturation: FloatArray
) -> tuple[FloatArray | BoolArray | IntArray, ...]:
    """The fields of ``Smooth`` for a stretch, at full rate."""
    rate = log.rate(part)
    position, force = log.position[part], log.force[part]
    full = saturated(force, saturation, filter_reach(lowpass, rate))
    if lowpass is not None:
        position, force = lowpass.apply(position, rate), lowpass.apply(force, rate)
    velocity = differentiate(position, rate)
    acceleration = differentiate(velocity, rate)
    return log.time[part], position, velocity, acceleration, force, full, log.stretches[part]


def _stride(rate: float, lowpass: LowPass | None) -> int:
    if lowpass is None:
        return 1
    # Rates are measured: one that is a little short of a whole number of times is meant to be it.
    return max(int((1 + ROUNDING) * rate / (LEAST_OVERSAMPLING * lowpass.cutoff)), 1)


def _dropped(reason: str, time: FloatArray) -> Dropped:
    return Dropped(reason, len(time), float(time[0]), float(time[-1]))
