"""From a file of any registered format to a log: read, map columns, and check for its robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import DataWarning, FileError, LogError, ModelWarning, OptionError, warn
from loopid.files import require_name, why_no_file
from loopid.logs.columns import ColumnFinder
from loopid.logs.formats import LogFormat, numbers_in, stream_name
from loopid.logs.free import POSE, continued, require_known_motion
from loopid.logs.log import Log
from loopid.logs.mapping import QUANTITIES, LogMapping, read_mapping
from loopid.logs.streams import LogTolerances, Stream, make_stream, on_joints, rows_text
from loopid.logs.wrenches import frame_index
from loopid.registry import log_formats
from loopid.robot.mechanism import Mechanism


@checked
def read_log(
    path: str | Path,
    robot: Mechanism,
    *,
    mapping: LogMapping | str | Path | None = None,
    rows: tuple[int, int | None] | None = None,
    tolerances: LogTolerances = LogTolerances(),
) -> Log:
    """Read the positions and forces of the motors.

    Parameters
    ----------
    path : path
        A table of text (.csv, .txt, .tsv, also .gz), Parquet, an .npz, a folder with one table a
        stream; with the extra ``logs`` also HDF5, or a bag of ROS 1 or 2 (.bag, .mcap, .db3, or
        the folder of one) with messages of type ``sensor_msgs/JointState``. More formats may be
        registered in ``loopid.registry.log_formats``.
    robot : Mechanism
    mapping : LogMapping or path, optional
        Which columns are what, and their units; by default as their names say, in SI units.
    rows : tuple of int, optional
        First and last row (None for the end) to be read, as messages count them: as if there were
        no others. In a log of several streams, of that with the first position.
    tolerances : LogTolerances
        What may be wrong with a log.

    Returns
    -------
    Log
        Evenly sampled in stretches without gaps, at the rate of the positions.

    Raises
    ------
    FileError
        When there is no such log or mapping.
    MissingExtraError
        When the library that reads the format is not installed.
    OptionError
        When motors and free joints do not tell where the robot is, or no row is within ``rows``.
    LogError
        When it is no log of this robot: unreadable, columns not found, times that do not increase,
        too many bad rows, the wrong unit, nothing that moves.

    Warns
    -----
    DataWarning
        Of rows that are left out, and of values that look wrong.

    Examples
    --------
    >>> import loopid
    >>> from loopid.loading import bundled_directory
    >>> robot = loopid.load_mechanism("five_bar")
    >>> loopid.read_log(bundled_directory() / "logs" / "five_bar.csv", robot)
    <Log 'five_bar': 2241 samples of left_crank_joint, right_crank_joint over 22.40 s in 1 stretch>
    """
    require_name(path, "the log")
    mapping = mapping if isinstance(mapping, LogMapping) else _mapping(mapping)
    require_known_motion(robot, mapping.free)
    place = _existing(path)
    for wrench in mapping.wrenches:
        frame_index(robot, wrench.frame)
    found = read_streams(
        place, robot.actuated, mapping, rows=rows, tolerances=tolerances, locked=robot.locked
    )
    streams = [check_stream(robot, stream, tolerances) for stream in found]
    check_moving(streams)
    name = stream_name(place.resolve())
    log = Log.from_streams(name, streams, robot.actuated, mapping, tolerances)
    check_rates(log, tolerances)
    return log


def _mapping(path: str | Path | None) -> LogMapping:
    return LogMapping() if path is None else read_mapping(path)


def _existing(path: str | Path) -> Path:
    """A log that is there."""
    place = Path(path)
    reason = why_no_file(place)
    if reason == "does not exist":
        raise FileError(f"there is no log {place}", file=place)
    if reason not in ("", "is a folder"):
        raise LogError(f"log {place} {reason}", file=place)
    return place


def read_streams(
    path: Path,
    joints: tuple[str, ...],
    mapping: LogMapping,
    *,
    rows: tuple[int, int | None] | None = None,
    tolerances: LogTolerances = LogTolerances(),
    locked: Mapping[str, float | None] | None = None,
) -> list[Stream]:
    """The streams of the motors, that of the first position first; of it, only some ``rows``.

    Positions of joints that are locked, at some value, must be those of the log.
    """
    if rows is not None and (rows[0] < 1 or (rows[1] is not None and rows[1] < rows[0])):
        raise OptionError(
            f"rows must be counted from 1, the first before the last, not {rows}", given=rows
        )
    log = open_log(path, mapping)
    source = str(path)
    finder = ColumnFinder(source, log.columns(), mapping, log.ordered, log.choice)
    refuse_moved(source, log, finder, locked or {})
    streams: list[Stream] = []
    channels_of = finder.channels(mapping.measured(source, joints))
    delays = mapping.stream_delays(source, joints, [*channels_of])
    for name, channels in channels_of.items():
        time = finder.time(name)
        columns = [channel.column for channel in channels]
        for table in log.tables(name, time.names, columns):
            source = log.source(name)
            if rows is not None and not streams:
                table = table.between(*rows)
                source = f"{source}[{rows[0]}:{'' if rows[1] is None else rows[1]}]"
            here = tuple(c for c in channels if c.column in table.cells.columns)
            stream = make_stream(source, table, time, here, tolerances)
            stream = stream.earlier(delays.get(name, 0.0))
            streams.append(on_joints(stream, mapping.joint_maps))
    return streams


def refuse_moved(
    source: str, log: LogFormat, finder: ColumnFinder, locked: Mapping[str, float | None]
) -> None:
    """Refuse a log in which a joint that is locked stands elsewhere, or moves."""
    for joint, value in _elsewhere(source, log, finder, locked).items():
        raise LogError(
            f"{source}: {joint} is locked at {locked[joint]:.6g}, but stands at {value:.6g}: load "
            f'the robot with lock=["{joint}={value:.6g}"]',
            source=source,
            joint=joint,
            given=value,
            tolerance=LOCKED,
        )


def _elsewhere(
    source: str, log: LogFormat, finder: ColumnFinder, locked: Mapping[str, float | None]
) -> dict[str, float]:
    """Where a log has joints that are locked elsewhere; one in which they move is refused."""
    found = {}
    for joint, value in locked.items():
        column = finder.own_position(joint)
        if value is None or column is None:
            continue
        place, scale = column
        times = finder.time(place.stream).names
        (table, *_) = log.tables(place.stream, times, [place.column])
        positions = scale * numbers_in(source, table.cells[place.column])
        low, high = np.nanpercentile(positions, (1, 99)) if len(positions) else (value, value)
        if high - low > LOCKED:
            raise LogError(
                f"{source}: {joint} is locked, but moves from {low:.4g} to {high:.4g} in column "
                f"{place.column!r}: load the robot without that lock",
                source=source,
                joint=joint,
            )
        middle = float(np.nanmedian(positions))
        if abs(middle - value) > LOCKED:
            found[joint] = middle
    return found


@checked
def locked_as_logged(
    robot: Mechanism, path: str | Path, *, mapping: LogMapping | str | Path | None = None
) -> Mechanism:
    """The robot, its locked joints where a log has them.

    Parameters
    ----------
    robot : Mechanism
        Of a file; others stay as they are, and ``read_log`` says which ``lock`` would do.
    path, mapping
        As of ``read_log``.

    Raises
    ------
    LogError
        When a joint that is locked moves.

    Warns
    -----
    ModelWarning
        Of joints that are locked elsewhere for the log.
    """
    from loopid.loading.load import load_mechanism  # logs are read without it

    if not any(value is not None for value in robot.locked.values()):
        return robot
    mapping = mapping if isinstance(mapping, LogMapping) else _mapping(mapping)
    log = open_log(_existing(path), mapping)
    finder = ColumnFinder(str(path), log.columns(), mapping, log.ordered, log.choice)
    found = _elsewhere(str(path), log, finder, robot.locked)
    if not found or robot.path is None:
        return robot
    places = ", ".join(f"{joint} at {value:.6g}" for joint, value in found.items())
    warn(f"{path}: locked where the log has it: {places}", ModelWarning)
    given = robot.options["lock"]
    lock = [each for each in given if (each.rpartition("=")[0] or each) not in found]
    lock += [f"{joint}={value:.6g}" for joint, value in found.items()]
    return load_mechanism(robot.path, **{**robot.options, "lock": lock})


def open_log(path: Path, mapping: LogMapping) -> LogFormat:
    """The log in its format: as the mapping says, or that of those registered which accepts it."""
    accepting = (name for name in reversed([*log_formats]) if log_formats[name].accepts(path))
    name = mapping.format or next(accepting, None)
    if name is None:
        endings = dict.fromkeys(end for kind in log_formats for end in log_formats[kind].endings)
        raise LogError(
            f"{path} is of no known format: its name must end in {', '.join(endings)}; otherwise "
            f"give the format in a mapping ({', '.join(sorted(log_formats))})",
            file=path,
            valid=tuple(endings),
        )
    kind: type[LogFormat] = log_formats[name]
    for key in ("topic", "group"):
        if getattr(mapping, key) is not None and kind.choice != key:
            raise LogError(
                f"{path}: {key} {getattr(mapping, key)!r} of the mapping chooses nothing in a log "
                f"of format {name}",
                file=path,
                key=key,
                format=name,
            )
    chosen = getattr(mapping, kind.choice) if kind.choice else None
    return kind(path, chosen, mapping.unpacked_ratio)


# How far a locked joint may be from its lock, in rad or m.
LOCKED = 2e-3
# ---- what a robot lets expect ------------------------------------------------------------------

# Factors that would make a unit of another one.
OTHER_TIMES = (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9)
OTHER_LENGTHS = {"0.001 (mm to m)": 1e-3, "1000 (km to m)": 1e3, "1e-6 (um to m)": 1e-6}
OTHER_ANGLES = {"pi/180 (deg to rad)": np.pi / 180, "0.001 (mrad to rad)": 1e-3}
FITTING = 0.9  # part of the values that a change of unit must bring inside
EXCESS = 1e-3  # relative, over a limit of speed or force: the round-off of how it was written
COMPARED_OVER = 0.5  # s over which measured rates are compared with changes of the position


def check_stream(robot: Mechanism, stream: Stream, allowed: LogTolerances) -> Stream:
    """The stream without impossible rows, and with turns counted on; warns of what looks wrong."""
    _require_usual_step(stream, allowed)
    _require_units(robot, stream)
    stream = _inside_limits(robot, stream, allowed)
    stream = _unwrapped(robot, _without_glitches(stream, allowed))
    seconds, model = np.diff(stream.stamps) / 1e9, robot.model
    for joint, values in stream.signals("position"):
        limit = model.upperVelocityLimit[robot.velocity_indices([joint])[0]]
        speeds = np.append(0.0, np.abs(np.diff(values)) / seconds)
        _warn_of_excess(stream, f"the speed of {joint}", limit, speeds)
    for joint, values in stream.signals("force"):
        limit = model.upperEffortLimit[robot.velocity_indices([joint])[0]]
        _warn_of_excess(stream, f"the force of {joint}", limit, np.abs(values))
    return stream


def _require_usual_step(stream: Stream, allowed: LogTolerances) -> None:
    """Refuse steps between stamps that are too short or long for a log."""
    shortest, longest = allowed.shortest_step, allowed.longest_step
    step = float(np.median(np.diff(stream.stamps))) / 1e9
    if not shortest <= step <= longest:
        fitting = [factor for factor in OTHER_TIMES if shortest <= step * factor <= longest]
        factors = " or ".join(f"{factor:g}" for factor in fitting)
        raise stream.refused(
            f"the median step between time stamps is {step:.3g} s, but must be "
            f"from {shortest:g} to {longest:g} s: give the unit of the time in a mapping"
            f"{f'; times {factors} it would fit' if factors else ''}",
            step=step,
            fitting=tuple(fitting),
        )


def _require_units(robot: Mechanism, stream: Stream) -> None:
    """Refuse columns whose header has a unit of slides where the joint turns, or of hinges."""
    for what in (one for one in stream.channels if one.quantity in QUANTITIES):
        straight = robot.velocity_indices([what.joint])[0] in robot.prismatic
        if what.straight is not None and what.straight != straight:
            said = ("turns", "slides") if what.straight else ("slides", "turns")
            raise stream.refused(
                f"the unit of column {what.column!r} is that of a joint that "
                f"{said[1]}, but {what.joint} {said[0]}: give {what.quantity}_scale in a mapping "
                "if the column is right",
                joint=what.joint,
                column=what.column,
            )


def _inside_limits(robot: Mechanism, stream: Stream, allowed: LogTolerances) -> Stream:
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
                f"{joint} is outside its limits [{lower:g}, {upper:g}] in "
                f"{rows_text(stream.rows[told])} of {len(values)}, at worst {worst:g}"
            )
            if refused:
                straight = robot.velocity_indices([joint])[0] in robot.prismatic
                advice = _advice(straight, lower, upper, values)
                facts = {"joint": joint, "limits": (lower, upper), "given": worst}
                raise stream.refused(f"{said}; {advice}", **facts)
            warn(f"{stream.source}: {said}: kept", DataWarning)
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


def _without_glitches(stream: Stream, allowed: LogTolerances) -> Stream:
    """The stream without rows where a force is out of all proportion."""
    sizes = np.abs(stream.values[:, stream.places("force")])
    usual = np.percentile(sizes, 99, axis=0)
    bad = np.any((sizes > allowed.glitch * usual) & (usual > 0), axis=1)
    reason = f"forces more than {allowed.glitch:g} times their 99th percentile"
    return stream.without(bad, reason, allowed.bad_rows)


def _unwrapped(robot: Mechanism, stream: Stream) -> Stream:
    """The stream with turns counted on that are reset after a turn; quaternions keep their sign."""
    values = stream.values.copy()
    for k in stream.places("position"):
        if robot.joint(stream.channels[k].joint).nq == 2:
            values[:, k] = np.unwrap(values[:, k])
    for quantity in {channel.quantity for channel in stream.channels} - {*QUANTITIES}:
        own = stream.places(quantity)
        if len(own) == len(POSE):
            values[:, own] = continued(values[:, own])
    return replace(stream, values=values)


def _warn_of_excess(stream: Stream, what: str, limit: float, sizes: FloatArray) -> None:
    """Warn of sizes (R,) beyond a limit; zero stands for none, as exporters write it."""
    beyond = sizes > (limit * (1 + EXCESS) if limit > 0 else np.inf)
    if beyond.any():
        warn(
            f"{stream.source}: {what} exceeds its limit of {limit:g} in "
            f"{rows_text(stream.rows[beyond])}, at worst {sizes.max():.4g}",
            DataWarning,
        )


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
    """Refuse measured rates that are not those of the positions.

    Integrals are compared with differences over the same time, where noise and delays of drives do
    not matter.
    """
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


def _both_changes(log: Log, k: int, rates: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Changes over some time, integrated from rates (N,) and of the position of motor k.

    Accelerations are integrated twice, and compared with changes of the changes.
    """
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
