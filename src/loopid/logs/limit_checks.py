"""Positions against the limits of the joints: wrong units, glitches, values just outside."""

from __future__ import annotations

import warnings

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import LogError, LogWarning
from loopid.logs.messages import rows_text
from loopid.logs.stream import MOST_BAD_ROWS, Channel, Stream
from loopid.robot import Mechanism
from loopid.scratch import row_blocks, rows_where

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
        values = stream.values[:, k]
        lost, near = _outside_rows(values, *_limits(mechanism, channel.joint))
        if len(lost) > MOST_BAD_ROWS * len(values):
            raise LogError(_wrong_unit(mechanism, stream, channel, lost, values))
        _warn_outside(mechanism, stream, channel, near, values)
        far = np.union1d(far, lost)
    return stream.without(far, "positions far outside the limits of their joints")


def _outside_rows(values: FloatArray, lower: float, upper: float) -> tuple[IntArray, IntArray]:
    """Rows of values (R,) that are far outside limits, and those that are less so."""
    width = upper - lower
    outside = rows_where(
        lambda rows: _distance(values[rows], lower, upper) > OUTSIDE * width, len(values)
    )
    far = _distance(values[outside], lower, upper) > FAR_OUTSIDE * width
    return outside[far], outside[~far]


def _distance(values: FloatArray, lower: float, upper: float) -> FloatArray:
    """How far values (R,) are outside limits; negative inside."""
    return np.maximum(lower - values, values - upper)


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
    worst = values[rows[np.argmax(_distance(values[rows], lower, upper))]]
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
        if _fitting(values, factor, lower, upper) >= FITTING:
            return f"{outside}; times {name} they would fit: give position_scale in a mapping"
    if _extent(values) <= upper - lower:
        return f"{outside}; with position_offset in a mapping they would fit"
    return f"{outside}; no change of unit brings them inside: are they those of another joint?"


def _fitting(values: FloatArray, factor: float, lower: float, upper: float) -> float:
    """Fraction of the values (R,) that a factor brings inside limits."""
    scaled = (values[rows] * factor for rows in row_blocks(len(values)))
    return sum(int(((x >= lower) & (x <= upper)).sum()) for x in scaled) / len(values)


def _extent(values: FloatArray) -> float:
    """Difference between the largest and the smallest of the values (R,)."""
    ends = [(values[rows].min(), values[rows].max()) for rows in row_blocks(len(values))]
    return float(max(end[1] for end in ends) - min(end[0] for end in ends))
