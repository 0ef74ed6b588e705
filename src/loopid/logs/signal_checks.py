"""What positions and forces must look like to be signals of a moving robot."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import LogError, LogWarning
from loopid.logs.messages import rows_text
from loopid.logs.stream import Stream
from loopid.order_statistics import Signal, largest, percentile
from loopid.robot import Mechanism
from loopid.scratch import row_blocks, rows_where, spooled, steps

# Forces this many times their 99th percentile are no forces.
GLITCH = 100.0
# Relative excess over a limit that is round-off of how it was written.
EXCESS = 1e-3


def check_moving(streams: list[Stream]) -> None:
    """Find sensors that always show the same.

    Raises
    ------
    LogError
        When no position changes.

    Warns
    -----
    LogWarning
        Naming the joints whose position or force never changes.
    """
    changes = {
        (channel.quantity, channel.joint): bool(changes)
        for stream in streams
        for channel, changes in zip(stream.channels, _changes(stream.values), strict=True)
    }
    source = streams[0].source
    if not any(moves for (quantity, _), moves in changes.items() if quantity == "position"):
        raise LogError(f"{source}: no position ever changes, so nothing moves")
    for quantity in ("position", "force"):
        dead = [joint for (what, joint), moves in changes.items() if what == quantity and not moves]
        if dead:
            message = f"{source}: the {quantity} of {', '.join(dead)} never changes: a dead sensor?"
            warnings.warn(message, LogWarning, stacklevel=3)


def _changes(values: FloatArray) -> BoolArray:
    """Which columns of values (R, k) are not the same all along (k,)."""
    flags = [(values[rows] != values[0]).any(axis=0) for rows in row_blocks(len(values))]
    return np.asarray(np.any(flags, axis=0), dtype=bool)


def drop_glitches(stream: Stream) -> Stream:
    """The stream without rows where a force is out of all proportion."""
    bad = np.empty(0, dtype=np.int64)
    for k, _ in _channels(stream, "force"):
        size = partial(_size, stream, k)
        usual = percentile(size, len(stream), 99)
        found = _beyond(GLITCH * usual, size, len(stream)) if usual > 0 else bad
        bad = np.union1d(bad, found)
    return stream.without(bad, f"forces more than {GLITCH:g} times their 99th percentile")


def unwrap_turns(mechanism: Mechanism, stream: Stream) -> Stream:
    """The stream with joints that turn without end counted on, not reset after each turn."""
    positions = _channels(stream, "position")
    turning = [k for k, joint in positions if mechanism.joint(joint).nq == 2]
    if not turning:
        return stream
    return replace(stream, values=spooled(_counted_on(stream.values, turning)))


def _counted_on(values: FloatArray, columns: list[int]) -> Iterator[FloatArray]:
    """Blocks of values (R, k), some columns of which are unwrapped."""
    turns = np.zeros(len(columns))
    for rows in row_blocks(len(values)):
        block = values[max(rows.start - 1, 0) : rows.stop].copy()
        block[:, columns] = np.unwrap(block[:, columns], axis=0) + turns
        yield block[len(block) - (rows.stop - rows.start) :]
        turns = block[-1, columns] - values[rows.stop - 1, columns]


def check_speeds(mechanism: Mechanism, stream: Stream) -> None:
    """Warn of rows between which a joint moves faster than its velocity limit."""
    for k, joint in _channels(stream, "position"):
        limit = _limit(mechanism, mechanism.model.upperVelocityLimit, joint)
        signal, count = partial(_speed, stream, k), len(stream) - 1
        fast = _beyond(limit * (1 + EXCESS), signal, count)
        if len(fast):
            worst = largest(signal, count)
            warnings.warn(
                f"{stream.source}: {joint} moves faster than its limit of {limit:g} per s "
                f"before {rows_text(stream.rows[fast + 1])}, at worst {worst:.3g} per s",
                LogWarning,
                stacklevel=3,
            )


def check_efforts(mechanism: Mechanism, stream: Stream) -> None:
    """Warn of rows where a force exceeds the effort limit of its joint."""
    for k, joint in _channels(stream, "force"):
        limit = _limit(mechanism, mechanism.model.upperEffortLimit, joint)
        signal, count = partial(_size, stream, k), len(stream)
        strong = _beyond(limit * (1 + EXCESS), signal, count)
        if len(strong):
            worst = largest(signal, count)
            warnings.warn(
                f"{stream.source}: the force of {joint} exceeds its effort limit of "
                f"{limit:g} in {rows_text(stream.rows[strong])}, at worst {worst:.4g}",
                LogWarning,
                stacklevel=3,
            )


def _channels(stream: Stream, quantity: str) -> list[tuple[int, str]]:
    """Columns of a quantity, and their joints."""
    channels = enumerate(stream.channels)
    return [(k, channel.joint) for k, channel in channels if channel.quantity == quantity]


def _beyond(limit: float, signal: Signal, count: int) -> IntArray:
    """Where a signal of so many values is above a limit."""
    return rows_where(lambda rows: np.greater(signal(rows), limit), count)


def _speed(stream: Stream, k: int, rows: slice) -> FloatArray:
    way, seconds = steps(stream.values[:, k], rows), steps(stream.stamps, rows) / 1e9
    return np.asarray(np.abs(way) / seconds, dtype=np.float64)


def _size(stream: Stream, k: int, rows: slice) -> FloatArray:
    return np.abs(stream.values[rows, k])


def _limit(mechanism: Mechanism, limits: FloatArray, joint: str) -> float:
    """A limit of a joint; zero stands for none, as exporters write it."""
    value = float(limits[mechanism.velocity_indices([joint])[0]])
    return value if value > 0 else np.inf
