"""What is checked of a log: that it is of its robot, in the right units, and of a motion."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from loopid.arguments import BoolArray, FloatArray, checked
from loopid.errors import DataWarning, LogError, OptionError, warn
from loopid.logs.grid import BAD_ROWS, Dropped, Stream, continued, off_grid, rows_text, stream_of
from loopid.logs.log import Log
from loopid.logs.signals import POSE
from loopid.logs.table import NANOSECONDS, QUANTITIES
from loopid.robot.robot import Robot, link_frames, lock_options

# Factors that would make a unit of another one.
OTHER_LENGTHS = {"0.001 (mm to m)": 1e-3, "1000 (km to m)": 1e3, "1e-6 (um to m)": 1e-6}
OTHER_ANGLES = {"pi/180 (deg to rad)": np.pi / 180, "0.001 (mrad to rad)": 1e-3}
# Seconds between stamps, at the median: others mean another unit of the time.
SHORTEST_STEP, LONGEST_STEP = 1e-5, 0.2
# Parts of a joint's range that positions may be outside its limits: without a word, and at all.
OUTSIDE, FAR_OUTSIDE = 1e-3, 1.0
# Part of a step by which samples may be off even steps: those of logs on a grid are within a tenth
# of it.
UNEVEN = 0.1
GLITCH = 100.0  # forces this many times their 99th percentile are none
# A spike is off the median of itself and two samples on either side by this many times as much as
# 99 % of its signal are, and by this many of the largest steps of these medians.
SPIKE, FAST = 20.0, 2.0
# Measured rates and changes of the position: relative difference (root mean square) that passes
# without a word, and ratio, or its inverse, from which on the rates are something else.
APART, GAIN = 0.1, 1.25
# In samples, from which on velocities may be late: differences are by half a one.
LATE = 0.25
FITTING = 0.9  # part of the values that a change of unit must bring inside
EXCESS = 1e-3  # relative, over a limit of speed or force: the round-off of how it was written
# A step of rad from which on a joint that may turn further was counted from anew, not that fast.
RESET = 0.9 * 2 * np.pi
# Sizes that bounce off zero: how often at least, parts of their 99th percentile that are near zero
# and far from it, and samples near it over those between. At a steady slope these are a third, at a
# smooth turn as many.
BOUNCES, NEAR_ZERO, STEEP = 5, (0.05, 0.2), 0.6
COMPARED_OVER = 0.5  # s over which measured rates are compared with changes of the position


@checked
def check_log(robot: Robot, log: Log) -> Log:
    """The log without impossible samples; warns of what looks wrong, as ``read_log`` does.

    One that was compared with its robot before stays as it is.

    Parameters
    ----------
    robot : Robot
    log : Log

    Returns
    -------
    Log

    Raises
    ------
    LogError
        When it is no log of this robot: the wrong unit, too many bad samples, nothing that moves.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> robot = loopid.load("four_bar")
    >>> still = np.zeros((100, 1))
    >>> log = loopid.Log.from_arrays(np.arange(100) / 100, still, still, robot.actuated)
    >>> loopid.logs.check_log(robot, log)
    Traceback (most recent call last):
    loopid.errors.LogError: log: no position ever changes, so nothing moves
    """
    if log.checked:
        return log
    _require_even_segments(log)
    given = {name: getattr(log, name) for name in QUANTITIES if getattr(log, name) is not None}
    whole = stream_of(log.name, log.joints, log.time, given, log.slides)
    (stream,) = check_streams(robot, [whole], static=log.static)
    if len(stream.rows) < len(log):
        dropped = (Dropped.at(why, log.time[lost - 1]) for why, lost in stream.left_out)
        log = log.select(np.isin(whole.rows, stream.rows), *dropped)
    columns = np.split(stream.values, len(given), axis=1)
    found: dict[str, Any] = dict(zip(given, columns, strict=True))
    return with_checked_rates(replace(log, checked=True, **found))


def _require_even_segments(log: Log) -> None:
    """Refuse a log whose steps are not even between gaps: only one that no maker put on a grid."""
    for part in log.parts():
        time = log.time[part]
        off, step = off_grid(time), 1 / log.rate(part) if len(time) > 1 else 0.0
        if off > UNEVEN * step:
            raise LogError(
                f"{log.name}: time stamps of segment {log.segments[part.start]} are up to "
                f"{off:.3g} s off even steps of {step:.3g} s: make the log by Log.from_arrays, "
                "which splits it at gaps and puts it on an even grid",
                tolerance=UNEVEN,
            )


def check_streams(robot: Robot, streams: Sequence[Stream], *, static: bool = False) -> list[Stream]:
    """Streams without impossible rows, and with turns counted on; warns of what looks wrong.

    Between poses at rest there are no speeds, and nothing tells whole turns.
    """
    found = [_check_stream(robot, stream, static) for stream in streams]
    _check_moving(found)
    forces = [force for stream in found for force in stream.signals("force")]
    if sizes := without_signs(forces):
        warn(f"{found[0].source}: {sizes}: sizes without their signs?", DataWarning)
    return found


def _check_stream(robot: Robot, stream: Stream, static: bool) -> Stream:
    if not static and len(stream.stamps) > 1:
        _require_usual_step(stream)
    _require_units(robot, stream)
    stream = _without_glitches(_inside_limits(robot, stream))
    model = robot.model
    if not static:
        stream = _without_spikes(_unwrapped(robot, stream))
        seconds = np.diff(stream.stamps) / 1e9
        for joint, values in stream.signals("position"):
            limit = model.upperVelocityLimit[robot.velocity_indices([joint])[0]]
            speeds = np.append(0.0, np.abs(np.diff(values)) / seconds)
            _warn_of_excess(stream, f"the speed of {joint}", limit, speeds)
    for joint, values in stream.signals("force"):
        limit = model.upperEffortLimit[robot.velocity_indices([joint])[0]]
        _warn_of_excess(stream, f"the force of {joint}", limit, np.abs(values))
    return stream


def _require_usual_step(stream: Stream) -> None:
    """Refuse steps between stamps that are too short or long for a log."""
    shortest, longest = SHORTEST_STEP, LONGEST_STEP
    step = float(np.median(np.diff(stream.stamps))) / 1e9
    if not shortest <= step <= longest:
        steps = {unit: step * each / 1e9 for unit, each in NANOSECONDS.items()}
        units = [
            f"{{column: NAME, unit: {unit}}} for {1 / own:.3g} Hz"
            for unit, own in steps.items()
            if shortest <= own <= longest
        ]
        do = "give times in s, or the rate of even rows in Hz"
        if units:
            do = (
                f"give the unit of the time in a mapping, as time: {' or '.join(units)}, or in "
                "units of Log.from_arrays"
            )
        raise stream.refused(
            f"the median step between time stamps is {step:.3g} s, but must be from {shortest:g} "
            f"to {longest:g} s: {do}"
        )


def _require_units(robot: Robot, stream: Stream) -> None:
    """Refuse columns whose header has a unit of slides where the joint turns, or of hinges."""
    for what in (one for one in stream.channels if one.quantity in QUANTITIES):
        straight = robot.slides(what.joint)
        if what.straight is not None and what.straight != straight:
            said = ("turns", "slides") if what.straight else ("slides", "turns")
            raise stream.refused(
                f"the unit of column {what.column!r} is that of a joint that "
                f"{said[1]}, but {what.joint} {said[0]}: give {what.quantity}_scale in a mapping "
                "if the column is right"
            )


def _inside_limits(robot: Robot, stream: Stream) -> Stream:
    """The stream without rows where a position is far outside the limits of its joint."""
    lost = np.zeros(len(stream.rows), dtype=bool)
    for k in stream.places("position"):
        joint, values = stream.channels[k].joint, stream.values[:, k]
        lower, upper = robot.limits(joint)
        if not lower < upper:  # limits that leave no room are none
            continue
        distance = np.maximum(lower - values, values - upper)
        outside = distance > OUTSIDE * (upper - lower)
        far = distance > FAR_OUTSIDE * (upper - lower)
        refused = far.sum() > BAD_ROWS * len(values)
        shown = far if refused else outside & ~far
        if shown.any():
            worst = float(values[shown][np.argmax(distance[shown])])
            said = (
                f"{joint} is outside its limits [{lower:g}, {upper:g}] in "
                f"{rows_text(stream.rows[shown])} of {len(values)}, at worst {worst:g}"
            )
            if refused:
                facts = {"joint": joint, "limits": (lower, upper), "given": worst}
                raise stream.refused(f"{said}; {_advice(robot, stream, k)}", **facts)
            warn(f"{stream.source}: {said}: kept", DataWarning)
        lost |= far
    return stream.without(lost, "positions far outside the limits of their joints")


def _advice(robot: Robot, stream: Stream, place: int) -> str:
    """What change of unit or origin would bring a column of positions inside its joint's limits."""
    own, values = stream.channels[place], stream.values[:, place]
    straight, (lower, upper) = robot.slides(own.joint), robot.limits(own.joint)
    # Of a turn of the motor a joint makes a part.
    turn = "m a turn" if straight else "2 pi"
    before = f"{turn} / (2 pi * ratio)" if straight else "1 / ratio"
    if (values == np.round(values)).all():
        before = f"{turn} / (counts a turn * ratio), as whole numbers are counts"
    for name, factor in (OTHER_LENGTHS if straight else OTHER_ANGLES).items():
        scaled = values * factor
        if ((scaled >= lower) & (scaled <= upper)).mean() >= FITTING:
            scale = f"{factor * own.scale:.10g}"
            every = [stream.channels[k] for k in stream.places("position")]
            alike = {c.joint: c.scale for c in every if robot.slides(c.joint) == straight}
            # A number for all would scale hinges and slides, or what has a scale of its own.
            if len(alike) < len(every) or len({*alike.values()}) > 1:
                numbers = (f"{joint}: {factor * given:.10g}" for joint, given in alike.items())
                scale = f"{{{', '.join(numbers)}}}"
            return (
                f"times {name} they would fit: give position_scale: {scale} in a mapping, or units "
                f"of Log.from_arrays; of motors before their gears it is {before}"
            )
    if np.ptp(values) <= upper - lower:
        return "with another zero, position_offset in a mapping, they would fit"
    return (
        "no change of unit brings them inside: are they those of another joint, or of motors "
        f"before their gears? The position_scale of these is {before}"
    )


def _without_glitches(stream: Stream) -> Stream:
    """The stream without rows where a force is out of all proportion."""
    sizes = np.abs(stream.values[:, stream.places("force")])
    usual = np.percentile(sizes, 99, axis=0)
    bad = np.any((sizes > GLITCH * usual) & (usual > 0), axis=1)
    reason = f"forces more than {GLITCH:g} times their 99th percentile"
    return stream.without(bad, reason)


def _unwrapped(robot: Robot, stream: Stream) -> Stream:
    """The stream with turns counted on that are reset after a turn; quaternions keep their sign."""
    values = stream.values.copy()
    for k in stream.places("position"):
        name = stream.channels[k].joint
        if robot.joint(name).nq == 2:
            values[:, k] = np.unwrap(values[:, k])
        elif not robot.slides(name):
            low, high = robot.limits(name)
            if high - low > 2 * np.pi:
                values[:, k] = np.unwrap(values[:, k], discont=RESET)
    for quantity in {channel.quantity for channel in stream.channels} - {*QUANTITIES}:
        own = stream.places(quantity)
        if len(own) == len(POSE):
            values[:, own] = continued(values[:, own])
    return replace(stream, values=values)


def _without_spikes(stream: Stream) -> Stream:
    """The stream with positions and forces interpolated where they jump there and back."""
    values = stream.values.copy()
    for quantity in ("position", "force"):
        for k in stream.places(quantity):
            spikes = spikes_of(values[:, k])
            if quantity == "force":  # that of friction is away for a sample where a motor halts
                sizes = np.abs(values[:, k])
                spikes &= sizes > FAST * sizes[~spikes].max()
            if spikes.any():
                found = f"the {quantity} of {stream.channels[k].joint} jumps there and back in"
                rows = rows_text(stream.rows[spikes])
                warn(f"{stream.source}: {found} {rows}: interpolated", DataWarning)
                known = stream.stamps[~spikes], values[~spikes, k]
                values[spikes, k] = np.interp(stream.stamps[spikes], *known)
    return replace(stream, values=values)


def spikes_of(values: FloatArray) -> BoolArray:
    """Where a signal (N,) jumps and is back after a sample or two.

    Noise, friction that turns and the steps of an encoder do so too, but not by so much more than
    usual. A jump to stay is none: the median has it too.
    """
    around = sliding_window_view(np.pad(values, 2, mode="edge"), 5)
    usual = np.median(around, axis=1)
    off = np.abs(values - usual)
    farthest = max(SPIKE * np.percentile(off, 99), FAST * np.abs(np.diff(usual)).max(initial=0.0))
    return np.asarray(off > farthest)


def _warn_of_excess(stream: Stream, what: str, limit: float, sizes: FloatArray) -> None:
    """Warn of sizes (R,) beyond a limit; zero stands for none, as exporters write it."""
    beyond = (limit > 0) & (sizes / (1 + EXCESS) > limit)
    if beyond.any():
        warn(
            f"{stream.source}: {what} exceeds its limit of {limit:g} in "
            f"{rows_text(stream.rows[beyond])}, at worst {sizes.max():.4g}",
            DataWarning,
        )


def _check_moving(streams: Sequence[Stream]) -> None:
    """Warn of joints whose position or force never changes; refuse when no position does."""
    source = streams[0].source
    for quantity in ("position", "force"):
        signals = (signal for stream in streams for signal in stream.signals(quantity))
        moves = {joint: bool(np.ptp(values)) for joint, values in signals}
        dead = [joint for joint, moved in moves.items() if not moved]
        if quantity == "position" and len(dead) == len(moves):
            said = f"{source}: no position ever changes, so nothing moves"
            raise LogError(said)
        if dead:
            warn(
                f"{source}: the {quantity} of {', '.join(dead)} never changes: a dead sensor?",
                DataWarning,
            )


def without_signs(forces: Sequence[tuple[str, FloatArray]]) -> str:
    """Why forces (R,) of motors look like sizes: none is negative, and one bounces off zero.

    Empty where they do not.
    """
    if any(values.min() < 0 for _, values in forces):
        return ""
    times, joint = max(((_bounces(values), joint) for joint, values in forces), default=(0, ""))
    if times < BOUNCES:
        return ""
    return (
        f"no force is ever negative, though that of {joint} comes down to zero {times} times and "
        "turns there at once"
    )


def _bounces(values: FloatArray) -> int:
    """How often sizes (R,) come down to zero, as steep there as above; 0 where they are flat."""
    level = np.digitize(values, np.array(NEAR_ZERO) * np.percentile(values, 99))
    ends = np.flatnonzero(level == 2)
    spells = [level[first + 1 : last] for first, last in pairwise(ends)]
    spells = [spell for spell in spells if not spell.all()]
    near = sum(int((spell == 0).sum()) for spell in spells)
    above = sum(int((spell == 1).sum()) for spell in spells)
    return len(spells) if near <= STEEP * above + len(spells) / 2 else 0


def with_checked_rates(log: Log) -> Log:
    """The log without velocities that are late; refuses rates that are not those of the positions.

    Integrals are compared with differences over the same time, where noise does not matter.
    """
    late, longest = dict[str, float](), max(log.parts(), key=lambda p: p.stop - p.start)
    for order, quantity in enumerate(("velocity", "acceleration"), 1):
        measured: FloatArray | None = getattr(log, quantity)
        if measured is None:
            continue
        for k, joint in enumerate(log.joints):
            integrals, changes = _both_changes(log, k, measured[:, k], order)
            size = float(changes @ changes)
            if size == 0:  # it stands
                continue
            gain, off = float(integrals @ changes) / size, integrals - changes
            apart = float(np.sqrt(off @ off / size))
            said = (
                f"{log.name}: the {quantity} of {joint} is {gain:.3g} times what its position "
                f"says, and differs from it by {apart:.0%} (root mean square)"
            )
            if not 1 / GAIN < gain < GAIN:
                raise LogError(
                    f"{said}: is it in another unit ({quantity}_scale), or of another?",
                    tolerance=GAIN,
                )
            if order == 1 and (lag := _clear_lag(off, changes)):
                late[joint] = lag / log.rate(longest)
            elif apart > APART:
                warn(f"{said}: is it late, noisy, or in need of {quantity}_offset?", DataWarning)
    if not late:
        return log
    worst = max(late, key=lambda joint: abs(late[joint]))
    warn(
        f"{log.name}: the velocity of {worst} is {1e3 * abs(late[worst]):.2g} ms "
        f"{'late' if late[worst] > 0 else 'early'} beside its position, as a filter or a "
        "difference makes it: velocities are those of the positions",
        DataWarning,
    )
    return replace(log, velocity=None)


def _clear_lag(off: FloatArray, changes: FloatArray) -> float:
    """Samples that rates are late by, which explain most of what they are off changes; or 0."""
    slope = np.gradient(changes)
    size, along = float(slope @ slope), float(off @ slope)
    clear = 0 < LATE * size < abs(along) and along**2 > size * float(off @ off) / 2
    return -along / size if clear else 0.0


def _both_changes(log: Log, k: int, rates: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Changes over some time: integrals of rates (N,), and of the position of motor k."""
    found = []
    for part in log.parts():
        rate, count, integral = log.rate(part), part.stop - part.start, rates[part]
        lag = max(1, min(round(COMPARED_OVER * rate), (count - 1) // (2 * order)))
        for _ in range(order):
            steps = (integral[1:] + integral[:-1]) / (2 * rate)
            integral = np.append(0.0, np.cumsum(steps))
        both = np.stack([integral, log.position[part, k]])
        for _ in range(order):
            both = both[:, lag:] - both[:, :-lag]
        found.append(both)
    integrals, changes = np.concatenate(found, axis=1)
    return integrals, changes


# ---- where a robot is -------------------------------------------------------------------------


def require_known_motion(robot: Robot, free: Collection[str] = ()) -> None:
    """Refuse robots whose configuration does not follow from the motors and these free joints."""
    known = measurable(robot)
    for name in free:
        OptionError.require("free joint", name, known, f" of {robot.name}")
    determined = robot.coordinates_of(free)
    left = [name for name in robot.free if name not in determined]
    if left:
        joints = [name for name in known if name not in free]
        advice = f", or measure {', '.join(joints)} ('free')" if joints else ""
        raise OptionError(
            f"a log of the motors does not determine {', '.join(left)} of {robot.name}, which "
            f"the motors leave free: lock them ({lock_options(robot, left)}){advice}",
            free=tuple(left),
            measurable=tuple(joints),
        )
    several = [name for name in robot.actuated if robot.joint(name).nv != 1]
    if several:
        raise OptionError(
            f"a log has one position a motor, but {', '.join(several)} of {robot.name} turn "
            "about several axes: name the motors in 'name_mot'"
        )


def measurable(robot: Robot) -> tuple[str, ...]:
    """Free joints that sensors measure: with one coordinate, or floating bases outside loops."""
    found = []
    for name in robot.joints:
        joint = robot.joint(name)
        own = slice(joint.idx_v, joint.idx_v + joint.nv)
        base = name in robot.floating and not robot.moving[:, own].any()
        if {*robot.coordinates_of([name])} <= {*robot.free} and (joint.nv == 1 or base):
            found.append(name)
    return tuple(found)


def frame_index(robot: Robot, name: str) -> int:
    """Index of a frame in Pinocchio's model; an OptionError for one that is not there, or fixed."""
    model = robot.model
    names = [frame.name for frame in model.frames]
    OptionError.require("frame", name, [*dict.fromkeys(names)], f" of {robot.name}")
    index = link_frames(model).get(name, names.index(name))
    if not robot.supports([index]).any():
        raise OptionError(f"frame {name} of {robot.name} does not move: no wrench moves it")
    return index
