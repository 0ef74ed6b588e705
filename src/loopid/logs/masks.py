"""Samples whose force says nothing about the model: the motor stands, or its drive saturates."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.logs.recording import Dropped
from loopid.order_statistics import percentile
from loopid.robot import Mechanism
from loopid.scratch import row_blocks
from loopid.trajectories import LowPass

# Standing: at most this fraction of the 99th percentile of a motor's own speed,
IDLE_FRACTION = 0.05
# or this fraction of that of the fastest motor of its kind: an encoder that only dithers.
DITHER_FRACTION = 0.01
# Forces within this fraction of the saturation are saturated.
SATURATION_TOLERANCE = 0.01
# Periods of the cut-off frequency, for a filter of second order, after which 1 % is left of what a
# single sample or the end of a stretch does to the filtered signal.
REACH = 1.0


class Extent(NamedTuple):
    """How many samples are flagged, and the times of the first and the last of them."""

    number: int
    first: float
    last: float


def idle_speeds(mechanism: Mechanism, velocity: FloatArray) -> FloatArray:
    """Speeds (dof,) at or below which motors with velocities (N, dof) count as standing."""
    columns = range(velocity.shape[1])
    usual = np.array([percentile(partial(_sizes, velocity, k), len(velocity), 99) for k in columns])
    straight = np.isin(mechanism.velocity_indices(mechanism.actuated), mechanism.prismatic)
    fastest = np.empty_like(usual)
    for kind in (straight, ~straight):
        fastest[kind] = usual[kind].max(initial=0.0)
    return np.maximum(IDLE_FRACTION * usual, DITHER_FRACTION * fastest)


def _sizes(values: FloatArray, k: int, rows: slice) -> FloatArray:
    return np.abs(values[rows, k])


def saturation_of(mechanism: Mechanism, force: FloatArray) -> FloatArray:
    """Forces (dof,) from which drives saturate by the effort limits of the robot file.

    A limit that the measured forces (N, dof) exceed is not what they saturate at; zero is how
    exporters write that there is none.
    """
    limits = mechanism.model.upperEffortLimit[mechanism.velocity_indices(mechanism.actuated)]
    largest = np.max([np.abs(force[rows]).max(axis=0) for rows in row_blocks(len(force))], axis=0)
    exceeded = largest > limits * (1.0 + SATURATION_TOLERANCE)
    return np.where((limits > 0) & ~exceeded, limits, np.inf)


def filter_reach(lowpass: LowPass | None, rate: float) -> int:
    """Samples around each other that a filter mixes."""
    if lowpass is None:
        return 0
    return int(np.ceil(REACH * max(lowpass.order, 2) / 2 * rate / lowpass.cutoff))


def saturated(force: FloatArray, saturation: FloatArray, reach: int) -> BoolArray:
    """Where (N, dof) raw forces, or others within reach of a filter, are saturated."""
    from scipy.ndimage import binary_dilation  # here, as it takes a while to import

    flags = np.abs(force) >= saturation * (1.0 - SATURATION_TOLERANCE)
    around = np.ones((2 * reach + 1, 1), dtype=bool)
    return np.asarray(binary_dilation(flags, around), dtype=bool)


def describe(reasons: Sequence[str], flags: BoolArray, time: FloatArray) -> tuple[Dropped, ...]:
    """For each column of flags (N, k) what is left out, where anything is."""
    found = []
    for reason, column in zip(reasons, flags.T, strict=True):
        count, first, last = extent(column, time)
        if count:
            found.append(Dropped(reason, count, first, last))
    return tuple(found)


def extent(flags: BoolArray, time: FloatArray) -> Extent:
    """How many samples (N,) are flagged, and when (N,)."""
    count, first, last = 0, np.nan, np.nan
    for rows in row_blocks(len(flags)):
        at = np.flatnonzero(flags[rows]) + rows.start
        if len(at):
            first, last = (time[at[0]] if not count else first), time[at[-1]]
            count += len(at)
    return Extent(count, float(first), float(last))
