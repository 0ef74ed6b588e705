"""What a robot lets expect of its log: times, limits, speeds, forces, and rates that fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import DataWarning, LogError, warn
from loopid.logs.log import Log
from loopid.logs.options import LogTolerances
from loopid.logs.streams import Stream, rows_text
from loopid.robot.mechanism import Mechanism

# Factors that would make a unit of another one.
OTHER_TIMES = (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9)
# From the smallest change on, as limits around zero hold whatever is small.
OTHER_LENGTHS = {"0.001 (mm to m)": 1e-3, "1000 (km to m)": 1e3, "1e-6 (um to m)": 1e-6}
OTHER_ANGLES = {"pi/180 (deg to rad)": np.pi / 180, "0.001 (mrad to rad)": 1e-3}
FITTING = 0.9  # part of the values that a change of unit must bring inside


def check_stream(robot: Mechanism, stream: Stream, allowed: LogTolerances) -> Stream:
    """The stream without impossible rows, and with turns counted on; warns of what looks wrong."""
    require_usual_step(stream, allowed)
    stream = inside_limits(robot, stream, allowed)
    stream = without_glitches(stream, allowed)
    stream = unwrapped(robot, stream)
    warn_of_speeds(robot, stream, allowed)
    warn_of_forces(robot, stream, allowed)
    return stream


def require_usual_step(stream: Stream, allowed: LogTolerances) -> None:
    """Refuse steps between stamps that are too short or long for a log."""
    shortest, longest = allowed.shortest_step, allowed.longest_step
    step = float(np.median(np.diff(stream.stamps))) / 1e9
    if not shortest <= step <= longest:
        fitting = [factor for factor in OTHER_TIMES if shortest <= step * factor <= longest]
        factors = " or ".join(f"{factor:g}" for factor in fitting)
        raise LogError(
            f"{stream.source}: the median step between time stamps is {step:.3g} s, but must be "
            f"from {shortest:g} to {longest:g} s: give the unit of the time in a mapping"
            f"{f'; times {factors} it would fit' if factors else ''}",
            source=stream.source,
            step=step,
            fitting=tuple(fitting),
        )


def inside_limits(robot: Mechanism, stream: Stream, allowed: LogTolerances) -> Stream:
    """The stream without rows where a position is far outside the limits of its joint."""
    lost = np.zeros(len(stream.rows), dtype=bool)
    for joint, values in stream.signals("position"):
        lower, upper = robot.limits(joint)
        if not lower < upper:  # limits that leave no room are none
            continue
        distance = np.maximum(lower - values, values - upper)
        outside = distance > allowed.outside * (upper - lower)
        far = distance > allowed.far_outside * (upper - lower)
        refused = far.sum() > allowed.bad_rows * len(values)
        told = far if refused else outside & ~far
        if told.any():
            worst = float(values[told][np.argmax(distance[told])])
            said = (
                f"{stream.source}: {joint} is outside its limits [{lower:g}, {upper:g}] in "
                f"{rows_text(stream.rows[told])} of {len(values)}, at worst {worst:g}"
            )
            if refused:
                straight = robot.velocity_indices([joint])[0] in robot.prismatic
                raise LogError(
                    f"{said}; {_advice(straight, lower, upper, values)}",
                    source=stream.source,
                    joint=joint,
                    limits=(lower, upper),
                    given=worst,
                )
            warn(f"{said}: kept", DataWarning)
        lost |= far
    return stream.without(
        lost, "positions far outside the limits of their joints", allowed.bad_rows
    )


def _advice(straight: bool, lower: float, upper: float, values: FloatArray) -> str:
    """What change of unit or origin would bring values (R,) inside limits."""
    for name, factor in (OTHER_LENGTHS if straight else OTHER_ANGLES).items():
        scaled = values * factor
        if ((scaled >= lower) & (scaled <= upper)).mean() >= FITTING:
            return f"times {name} they would fit: give position_scale in a mapping"
    if np.ptp(values) <= upper - lower:
        return "with position_offset in a mapping they would fit"
    return "no change of unit brings them inside: are they those of another joint?"


def without_glitches(stream: Stream, allowed: LogTolerances) -> Stream:
    """The stream without rows where a force is out of all proportion."""
    bad = np.zeros(len(stream.rows), dtype=bool)
    for _, values in stream.signals("force"):
        sizes = np.abs(values)
        usual = np.percentile(sizes, 99)
        if usual > 0:
            bad |= sizes > allowed.glitch * usual
    reason = f"forces more than {allowed.glitch:g} times their 99th percentile"
    return stream.without(bad, reason, allowed.bad_rows)


def unwrapped(robot: Mechanism, stream: Stream) -> Stream:
    """The stream with joints that turn without end counted on, not reset after each turn."""
    values = tuple(
        np.unwrap(signal)
        if what.quantity == "position" and robot.joint(what.joint).nq == 2
        else signal
        for what, signal in zip(stream.channels, stream.values, strict=True)
    )
    return replace(stream, values=values)


def warn_of_speeds(robot: Mechanism, stream: Stream, allowed: LogTolerances) -> None:
    """Warn of joints that are faster than they can be."""
    seconds = np.diff(stream.stamps) / 1e9
    for joint, values in stream.signals("position"):
        limit = _limit(robot, robot.model.upperVelocityLimit, joint)
        speed = np.abs(np.diff(values)) / seconds
        fast = np.flatnonzero(speed > limit * (1 + allowed.excess))
        if len(fast):
            warn(
                f"{stream.source}: {joint} moves faster than its limit of {limit:g} per s "
                f"before {rows_text(stream.rows[fast + 1])}, at worst {speed.max():.3g} per s",
                DataWarning,
            )


def warn_of_forces(robot: Mechanism, stream: Stream, allowed: LogTolerances) -> None:
    """Warn of motors that are stronger than they can be."""
    for joint, values in stream.signals("force"):
        limit = _limit(robot, robot.model.upperEffortLimit, joint)
        strong = np.abs(values) > limit * (1 + allowed.excess)
        if strong.any():
            warn(
                f"{stream.source}: the force of {joint} exceeds its effort limit of {limit:g} in "
                f"{rows_text(stream.rows[strong])}, at worst {np.abs(values).max():.4g}",
                DataWarning,
            )


def _limit(robot: Mechanism, limits: FloatArray, joint: str) -> float:
    value = float(limits[robot.velocity_indices([joint])[0]])
    return value if value > 0 else np.inf  # zero stands for none, as exporters write it


def check_moving(streams: Sequence[Stream]) -> None:
    """Warn of joints whose position or force never changes; refuse when no position does."""
    source = streams[0].source
    for quantity in ("position", "force"):
        signals = (signal for stream in streams for signal in stream.signals(quantity))
        moves = {joint: bool(np.ptp(values)) for joint, values in signals}
        dead = [joint for joint, moved in moves.items() if not moved]
        if quantity == "position" and len(dead) == len(moves):
            said = f"{source}: no position ever changes, so nothing moves"
            raise LogError(said, source=source, joints=tuple(dead))
        if dead:
            warn(
                f"{source}: the {quantity} of {', '.join(dead)} never changes: a dead sensor?",
                DataWarning,
            )


def check_rates(log: Log, allowed: LogTolerances) -> None:
    """Refuse measured velocities and accelerations that are not those of the positions.

    Compared are differences of positions over some time, with integrals over the same time: noise
    and the delays of filters in drives do not matter there.
    """
    for order, quantity in enumerate(("velocity", "acceleration"), 1):
        measured: FloatArray | None = getattr(log, quantity)
        if measured is None:
            continue
        for k, joint in enumerate(log.joints):
            integrals, changes = _both_changes(log, k, measured[:, k], order, allowed.compared_over)
            size = float(changes @ changes)
            if size == 0:  # it stands
                continue
            gain, off = float(integrals @ changes) / size, integrals - changes
            apart = float(np.sqrt(off @ off / size))
            said = (
                f"{log.name}: the {quantity} of {joint} is {gain:.3g} times what its position "
                f"says, and differs from it by {apart:.0%} (root mean square)"
            )
            if not 1 / allowed.gain < gain < allowed.gain:
                raise LogError(
                    f"{said}: is it in another unit ({quantity}_scale), or of another?",
                    source=log.name,
                    quantity=quantity,
                    joint=joint,
                    gain=gain,
                    tolerance=allowed.gain,
                )
            if apart > allowed.apart:
                warn(f"{said}: is it late, noisy, or in need of {quantity}_offset?", DataWarning)


def _both_changes(
    log: Log, k: int, rates: FloatArray, order: int, seconds: float
) -> tuple[FloatArray, FloatArray]:
    """Changes over some seconds, integrated from rates (N,) and of the position of motor k.

    Accelerations are integrated twice, and compared with changes of the changes.
    """
    found = []
    for part in log.parts():
        rate, count, integral = log.rate(part), part.stop - part.start, rates[part]
        lag = max(1, min(round(seconds * rate), (count - 1) // (2 * order)))
        for _ in range(order):
            steps = (integral[1:] + integral[:-1]) / (2 * rate)
            integral = np.append(0.0, np.cumsum(steps))
        both = np.stack([integral, log.position[part, k]])
        for _ in range(order):
            both = both[:, lag:] - both[:, :-lag]
        found.append(both)
    integrals, changes = np.concatenate(found, axis=1)
    return integrals, changes
