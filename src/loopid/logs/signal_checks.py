"""What positions and forces must look like to be signals of a moving robot."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import LogError, LogWarning
from loopid.logs.messages import rows_text
from loopid.logs.stream import Stream
from loopid.mechanism import Mechanism

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
        (channel.quantity, channel.joint): np.ptp(column) > 0
        for stream in streams
        for channel, column in zip(stream.channels, stream.values.T, strict=True)
    }
    source = streams[0].source
    if not any(moves for (quantity, _), moves in changes.items() if quantity == "position"):
        raise LogError(f"{source}: no position ever changes, so nothing moves")
    for quantity in ("position", "force"):
        dead = [joint for (what, joint), moves in changes.items() if what == quantity and not moves]
        if dead:
            message = f"{source}: the {quantity} of {', '.join(dead)} never changes: a dead sensor?"
            warnings.warn(message, LogWarning, stacklevel=3)


def drop_glitches(stream: Stream) -> Stream:
    """The stream without rows where a force is out of all proportion."""
    forces = [k for k, channel in enumerate(stream.channels) if channel.quantity == "force"]
    if not forces:
        return stream
    sizes = np.abs(stream.values[:, forces])
    usual = np.percentile(sizes, 99, axis=0)
    bad = np.flatnonzero(((sizes > GLITCH * usual) & (usual > 0)).any(axis=1))
    return stream.without(bad, f"forces more than {GLITCH:g} times their 99th percentile")


def unwrap_turns(mechanism: Mechanism, stream: Stream) -> Stream:
    """The stream with joints that turn without end counted on, not reset after each turn."""
    values = stream.values.copy()
    for k, channel in enumerate(stream.channels):
        if channel.quantity == "position" and mechanism.joint(channel.joint).nq == 2:
            values[:, k] = np.unwrap(values[:, k])
    return replace(stream, values=values)


def check_speeds(mechanism: Mechanism, stream: Stream) -> None:
    """Warn of rows between which a joint moves faster than its velocity limit."""
    seconds = np.diff(stream.stamps) / 1e9
    for k, channel in enumerate(stream.channels):
        limit = _limit(mechanism, mechanism.model.upperVelocityLimit, channel.joint)
        speed = np.abs(np.diff(stream.values[:, k])) / seconds
        fast = np.flatnonzero(speed > limit * (1 + EXCESS))
        if channel.quantity == "position" and len(fast):
            warnings.warn(
                f"{stream.source}: {channel.joint} moves faster than its limit of {limit:g} per s "
                f"before {rows_text(stream.rows[fast + 1])}, at worst {speed.max():.3g} per s",
                LogWarning,
                stacklevel=3,
            )


def check_efforts(mechanism: Mechanism, stream: Stream) -> None:
    """Warn of rows where a force exceeds the effort limit of its joint."""
    for k, channel in enumerate(stream.channels):
        limit = _limit(mechanism, mechanism.model.upperEffortLimit, channel.joint)
        sizes = np.abs(stream.values[:, k])
        strong = np.flatnonzero(sizes > limit * (1 + EXCESS))
        if channel.quantity == "force" and len(strong):
            warnings.warn(
                f"{stream.source}: the force of {channel.joint} exceeds its effort limit of "
                f"{limit:g} in {rows_text(stream.rows[strong])}, at worst {sizes.max():.4g}",
                LogWarning,
                stacklevel=3,
            )


def _limit(mechanism: Mechanism, limits: FloatArray, joint: str) -> float:
    """A limit of a joint; zero stands for none, as exporters write it."""
    value = float(limits[mechanism.velocity_indices([joint])[0]])
    return value if value > 0 else np.inf
