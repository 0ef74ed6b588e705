"""Filtered positions and forces with the derivatives of the positions, stretch by stretch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import checked
from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import LogError
from loopid.logs.log import Log
from loopid.logs.masks import filter_reach, saturated
from loopid.logs.recording import Dropped
from loopid.scratch import Spool, mapped_rows, row_blocks
from loopid.trajectories import JointMotion, LowPass, differentiate

# The default cut-off frequency, as a fraction of the sample rate.
DEFAULT_CUTOFF = 0.05
# Samples are kept at no less than this many times the cut-off frequency.
LEAST_OVERSAMPLING = 5.0
LEAST_SAMPLES = 3  # what it takes to differentiate
# Samples on either side that twice differentiated ones depend on, also at the ends of a stretch.
DIFFERENCES = 3
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

    def select(self, flags: BoolArray) -> Smooth:
        """The samples (N,) that are flagged, in order."""

        def chosen(column: NDArray[Any]) -> NDArray[Any]:
            return mapped_rows(lambda rows: column[rows][flags[rows]], len(flags))

        return Smooth(*(chosen(getattr(self, field.name)) for field in fields(self)))

    def motion(
        self, configurations: FloatArray, singularity: FloatArray, columns: list[int]
    ) -> JointMotion:
        """The motion of some columns, with configurations (N, nq) and singularity measures (N,)."""

        def chosen(signal: FloatArray) -> FloatArray:
            return mapped_rows(lambda rows: signal[rows][:, columns], len(signal))

        derivatives = chosen(self.velocity), chosen(self.acceleration)
        return JointMotion(self.time, configurations, *derivatives, singularity)


@checked
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
    spools, dropped = [Spool() for _ in fields(Smooth)], []
    for part in log.parts():
        rate, time = log.rate(part), log.time[part]
        least = LEAST_SAMPLES if lowpass is None or rate == 0 else lowpass.least_samples(rate)
        if len(time) < max(least, LEAST_SAMPLES):
            dropped.append(_dropped("stretch too short to filter", time))
            continue
        # Accelerations are wrong where a filter does not know what comes next.
        end = filter_reach(lowpass, rate) if trim else 0
        if end:
            dropped.append(_dropped("end of a stretch", np.append(time[:end], time[-end:])))
        step = _stride(rate, lowpass) if decimate else 1
        inner = slice(end, len(time) - end, step)
        for columns in _smooth_part(log, part, lowpass, saturation, inner):
            for spool, column in zip(spools, columns, strict=True):
                spool.append(column)
    if not len(spools[0]):
        longest = max(one.count for one in dropped)
        raise LogError(
            f"{log.name}: all stretches without gaps are too short to filter, the longest has "
            f"{longest} samples"
        )
    return Smooth(*(spool.array() for spool in spools)), (*dropped,)


def _smooth_part(
    log: Log, part: slice, lowpass: LowPass | None, saturation: FloatArray, inner: slice
) -> Iterator[tuple[FloatArray | BoolArray | IntArray, ...]]:
    """The fields of ``Smooth`` for some samples of a stretch, block by block."""
    rate, reach = log.rate(part), filter_reach(lowpass, log.rate(part))
    position, raw = log.position[part], log.force[part]
    force = raw if lowpass is None else lowpass.apply(raw, rate)
    if lowpass is not None:
        position = lowpass.apply(position, rate)
    for rows in row_blocks(slice(inner.start, inner.stop)):
        first = rows.start + (inner.start - rows.start) % inner.step
        chosen = slice(first, rows.stop, inner.step)
        around, within = _widened(rows, chosen, DIFFERENCES, len(raw))
        velocity = differentiate(position[around], rate)
        acceleration = differentiate(velocity, rate)[within]
        mixed, among = _widened(rows, chosen, reach, len(raw))
        full = saturated(raw[mixed], saturation, reach)[among]
        yield (
            log.time[part][chosen],
            position[chosen],
            velocity[within],
            acceleration,
            force[chosen],
            full,
            log.stretches[part][chosen],
        )


def _widened(rows: slice, chosen: slice, margin: int, count: int) -> tuple[slice, slice]:
    """A block of rows with others around it, and the chosen ones of them."""
    around = slice(max(rows.start - margin, 0), min(rows.stop + margin, count))
    return around, slice(chosen.start - around.start, rows.stop - around.start, chosen.step)


def _stride(rate: float, lowpass: LowPass | None) -> int:
    if lowpass is None:
        return 1
    # Rates are measured: one that is a little short of a whole number of times is meant to be it.
    return max(int((1 + ROUNDING) * rate / (LEAST_OVERSAMPLING * lowpass.cutoff)), 1)


def _dropped(reason: str, time: FloatArray) -> Dropped:
    return Dropped(reason, len(time), float(time[0]), float(time[-1]))
