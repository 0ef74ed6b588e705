"""Positions against the limits of the joints: wrong units, glitches, values just outside."""

from __future__ import annotations

import warnings

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import LogError, LogWarning
from loopid.logs.messages import rows_text
from loopid.logs.stream import MOST_BAD_ROWS, Channel, Stream
from loopid.mechanism import Mechanism

# Of the range of a joint: how far outside its limits a value may be without a word, and from how
# far on it is no position of the joint.
OUTSIDE = 1e-3
FAR_OUTSIDE = 1.0
# Fraction of the values that a change of unit must bring inside.
FITTING = 0.9
# From the smallest change on, as limits around zero hold whatever is small.
UNITS_OF_LENGTH = {"0.001 (mm to m)": 1e-3, "1000 (km to m)": 1e3, "1e-6 (um to m)": 1e-6}
UNITS_OF_ANGLE = {"pi/180 (deg to rad)": np.pi / 180, "0.001 (mrad to rad)": 1e-3}


def check_limits(mechanism: Mechanism, stream: Stream) -> Stream:
    """The stream without rows where a position is far outside the limits of its joint.

    Raises
    ------
    LogError
        When these are many, with the factor that would bring them inside.

    Warns
    -----
    LogWarning
        Of rows outside the limits, left out or not.
    """
    far = np.empty(0, dtype=np.int64)
    for k, channel in enumerate(stream.channels):
        if channel.quantity != "position":
            continue
        lower, upper = _limits(mechanism, channel.joint)
        values, width = stream.values[:, k], upper - lower
        distance = np.maximum(lower - values, values - upper)
        lost = np.flatnonzero(distance > FAR_OUTSIDE * width)
        if len(lost) > MOST_BAD_ROWS * len(values):
            raise LogError(_wrong_unit(mechanism, stream, channel, lost, values))
        near = np.flatnonzero((distance > OUTSIDE * width) & (distance <= FAR_OUTSIDE * width))
        _warn_outside(mechanism, stream, channel, near, values)
        far = np.union1d(far, lost)
    return stream.without(far, "positions far outside the limits of their joints")


def _limits(mechanism: Mechanism, joint: str) -> tuple[float, float]:
    """Limits of a joint; limits that leave no room are none."""
    lower, upper = mechanism.limits(joint)
    return (lower, upper) if lower < upper else (-np.inf, np.inf)


def _warn_outside(
    mechanism: Mechanism, stream: Stream, channel: Channel, rows: IntArray, values: FloatArray
) -> None:
    if len(rows):
        message = _outside(mechanism, stream, channel, rows, values)
        warnings.warn(f"{message}: kept", LogWarning, stacklevel=4)


def _outside(
    mechanism: Mechanism, stream: Stream, channel: Channel, rows: IntArray, values: FloatArray
) -> str:
    lower, upper = mechanism.limits(channel.joint)
    distance = np.maximum(lower - values[rows], values[rows] - upper)
    worst = values[rows[np.argmax(distance)]]
    return (
        f"{stream.source}: {channel.joint} is outside its limits [{lower:g}, {upper:g}] in "
        f"{rows_text(stream.rows[rows])} of {len(values)}, at worst {worst:g}"
    )


def _wrong_unit(
    mechanism: Mechanism, stream: Stream, channel: Channel, rows: IntArray, values: FloatArray
) -> str:
    outside = _outside(mechanism, stream, channel, rows, values)
    lower, upper = mechanism.limits(channel.joint)
    index = mechanism.velocity_indices([channel.joint])[0]
    units = UNITS_OF_LENGTH if index in mechanism.prismatic else UNITS_OF_ANGLE
    for name, factor in units.items():
        if ((values * factor >= lower) & (values * factor <= upper)).mean() >= FITTING:
            return f"{outside}; times {name} they would fit: give position_scale in a mapping"
    if np.ptp(values) <= upper - lower:
        return f"{outside}; with position_offset in a mapping they would fit"
    return f"{outside}; no change of unit brings them inside: are they those of another joint?"
