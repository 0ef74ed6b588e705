"""Logs: positions and forces of the motors over time, from arrays, tables or files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from loopid.arguments import (
    NOT_EMPTY,
    BoolArray,
    FloatArray,
    IntArray,
    NotNegative,
    Numbers,
    NumbersByJoint,
    by_name,
    chosen,
    finite,
    for_each,
    rectangular,
    samples,
    times,
)
from loopid.errors import DataError, OptionError, shown
from loopid.logs.grid import (
    Aligned,
    Dropped,
    Stream,
    align,
    free_values,
    make_streams,
    on_even_grids,
    on_joints,
    static_poses,
)
from loopid.logs.signals import (
    UNITS,
    ColumnFinder,
    Unit,
    free_name,
    unit_names,
    unit_of,
    wrench_name,
)
from loopid.logs.table import COMPONENTS, QUANTITIES, array_table, columns_in
from loopid.records import Tabular, columns_of, derived, record

if TYPE_CHECKING:
    from loopid.logs.mapping import LogMapping, WrenchColumns

# Degree of the spline between samples, off by 5e-4 of a signal at a fifth of the rate; and part of
# a step by which a delay of whole steps may be off one, and needs none.
DEGREE, WHOLE = 5, 1e-6

FINEST = 1e-6  # step of an encoder, relative to the range of its positions, that counts as none


@record(checked=True)
class ExternalWrench:
    """A measured force and moment of the surroundings on the robot.

    Attributes
    ----------
    frame : str
        Of the robot's Pinocchio model, on whose body the wrench acts.
    values : FloatArray
        (N, 6), force x, y, z in N and moment x, y, z in N m, which the surroundings exert on the
        robot: what a force plate measures has the other sign.
    axes : str
        Along which they are: ``"frame"``, or ``"world"``.
    about : tuple of float or None
        Point of the world, in m, about which the moments are, as of a force plate; by default the
        origin of the frame.

    Raises
    ------
    DataError
        When the values are not finite, or of another shape.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> weight = loopid.ExternalWrench("right_coupler", [[0, 0, -10.0, 0, 0, 0]], axes="world")
    >>> forces = loopid.logs.wrench_forces(robot, robot.reference, [weight])
    >>> forces.shape
    (2,)
    """

    frame: str
    values: FloatArray
    axes: Literal["frame", "world"] = "frame"
    about: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", self.rows())

    def rows(self, count: int | None = None) -> FloatArray:
        """The values (N, 6), of as many samples as required."""
        return samples(self.values, len(COMPONENTS), f"the wrench on {self.frame}", count)


@record(kw_only=True, checked=True)
class Log(Tabular):
    """Positions and forces of the motors over time, in segments without gaps.

    Made by ``read_log``, ``Log.from_arrays`` or ``Log.from_frame``.

    Attributes
    ----------
    name : str
    joints : tuple of str
        The m actuated joints, in the order of the columns.
    time : FloatArray
        (N,) in s, increasing, even within each segment.
    position, force : FloatArray
        (N, m) in m or rad, and N or N m.
    segments : IntArray
        (N,), number of the gap-free segment that a sample belongs to, ascending from 0.
    velocity, acceleration : FloatArray or None
        (N, m) in units of the positions and s, where they were measured.
    saturation : FloatArray or None
        (m,), force from which each drive saturates; by default the effort limit of the robot file
        unless a tenth of the forces exceeds it, or the force that they are clipped at.
    idle_speed : float or None
        Speed in m/s or rad/s at or below which a motor counts as standing, 0 if none ever does; by
        default a twentieth of the motor's own usual top speed.
    dropped : tuple of Dropped
        What was left out on the way here.
    wrenches : tuple of ExternalWrench
        Of N samples, that the surroundings exerted on the robot.
    force_scales : mapping
        By joint, what numbers of the file were multiplied by to be forces in N or N m.
    slides : mapping
        By ``joint.quantity``, whether its unit was one of slides, as m, or of hinges, as deg;
        without those whose unit nothing said.
    static : bool
        Whether samples are poses at rest, each of its own: nothing is filtered or differentiated,
        and times only count them.
    checked : bool
        Whether its values were compared with its robot: ``prepare`` does it otherwise.
    free : mapping
        Joints that no motor moves to where sensors measure them: (N, 1) in m or rad, of a
        floating base (N, 7), the position of its frame and a quaternion with w last.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> time = np.arange(0, 2, 0.01)
    >>> log = loopid.Log.from_arrays(time, np.sin(time), np.cos(time), ["crank_joint"])
    >>> log.rate(log.parts()[0])
    100.0
    """

    name: str
    joints: tuple[str, ...]
    time: FloatArray
    position: FloatArray
    force: FloatArray
    segments: IntArray
    velocity: FloatArray | None = None
    acceleration: FloatArray | None = None
    saturation: FloatArray | None = None
    idle_speed: NotNegative | None = None
    dropped: tuple[Dropped, ...] = ()
    wrenches: tuple[ExternalWrench, ...] = ()
    free: Mapping[str, FloatArray] = field(default_factory=dict)
    force_scales: Mapping[str, float] = field(default_factory=dict)
    slides: Mapping[str, bool] = field(default_factory=dict, compare=False)
    static: bool = False
    checked: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        if not self.joints:
            raise DataError("joints must name the motors of a log", argument="joints")
        twice = next((name for name in self.joints if self.joints.count(name) > 1), None)
        if twice is not None:
            raise DataError(f"joints: {twice} is named twice", argument="joints", given=twice)
        time = times(self.time)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "segments", _segments(self.segments, len(time)))
        for name in QUANTITIES:
            if name in ("position", "force") or getattr(self, name) is not None:
                values = samples(getattr(self, name), len(self.joints), name, len(time))
                object.__setattr__(self, name, values)
        for wrench in self.wrenches:
            wrench.rows(len(time))
        free = {name: free_values(name, own, len(time)) for name, own in self.free.items()}
        object.__setattr__(self, "free", free)
        if self.saturation is not None:
            limits = samples(self.saturation, len(self.joints), "saturation", 1)[0]
            if not limits.min() > 0:
                raise DataError(
                    f"saturation must be positive numbers, not {limits.tolist()}",
                    argument="saturation",
                )
            object.__setattr__(self, "saturation", limits)

    @classmethod
    def from_arrays(  # noqa: PLR0913 (a column each)
        cls,
        time: Numbers,
        position: NumbersByJoint,
        force: NumbersByJoint,
        joints: Sequence[str],
        *,
        velocity: NumbersByJoint | None = None,
        acceleration: NumbersByJoint | None = None,
        units: Mapping[str, str | Mapping[str, str]] | None = None,
        segments: Numbers | None = None,
        saturation: Numbers | None = None,
        idle_speed: float | None = None,
        wrenches: Sequence[ExternalWrench] = (),
        free: Mapping[str, Numbers] | None = None,
        name: str = "log",
    ) -> Log:
        """A log of what was measured or simulated, from arrays or columns of a DataFrame.

        Parameters
        ----------
        time : array
            (N,), increasing; up to 2 % of the samples may repeat the time of the one before.
        position, force : array
            (N, m), or (N,) of a single motor.
        joints : sequence of str
            The m motors, in the order of the columns. Columns of a DataFrame that are called as
            the motors are taken by name.
        velocity, acceleration : array, optional
            (N, m), where they were measured.
        units : mapping, optional
            From "time", "position", "force", "velocity" or "acceleration" to a unit such as
            "ms", "deg" or "kN", or to one a joint; by default s, m or rad, N or N m.
        segments : array, optional
            (N,), ascending numbers of the parts without gaps; those of fewer than four samples
            are left out. By default, and within each part, a step of more than five median steps
            is a gap, and uneven samples are interpolated linearly on an even grid, as ``read_log``
            does.
        saturation : array, optional
            (m,) in N or N m, see ``Log``.
        idle_speed : float, optional
            In m/s or rad/s, see ``Log``.
        wrenches : sequence of ExternalWrench
            Of N samples, that the surroundings exert on the robot.
        free : mapping, optional
            Where joints are that no motor moves, see ``Log``.

        Raises
        ------
        DataError
            When an array has another shape, is not finite, or time does not increase.
        OptionError
            When a unit is not known.

        Examples
        --------
        >>> import numpy as np, loopid
        >>> time = np.arange(0, 2, 0.01)
        >>> loopid.Log.from_arrays(time, 57.3 * np.sin(time), np.cos(time), ["crank_joint"],
        ...     units={"position": "deg"}, name="swing")
        <Log 'swing': 200 samples of crank_joint over 1.99 s in 1 segment>
        """
        joints, units = tuple(joints), units or {}
        for quantity in units:
            OptionError.require("quantity with a unit", quantity, UNITS)
        at = times(time, repeated=True) * _unit("time", units.get("time")).scale
        given = dict(zip(QUANTITIES, (position, force, velocity, acceleration), strict=True))
        signals, slides = dict[str, FloatArray](), dict[str, bool]()
        for quantity, values in given.items():
            if values is None:
                continue
            own = [_unit(quantity, unit) for unit in _by_joint(units.get(quantity), joints)]
            scales = [unit.scale for unit in own]
            array = finite(by_name(values, joints), quantity)
            array = array[:, None] if array.ndim == len(joints) == 1 else array
            signals[quantity] = samples(array, len(joints), quantity, len(at)) * scales
            slides |= {
                f"{joint}.{quantity}": unit.straight
                for joint, unit in zip(joints, own, strict=True)
                if unit.straight is not None
            }
        signals |= {wrench_name(k): one.rows(len(at)) for k, one in enumerate(wrenches)}
        signals |= {
            free_name(joint): free_values(joint, own, len(at))
            for joint, own in (free or {}).items()
        }
        numbers = _segments(np.zeros(len(at), int) if segments is None else segments, len(at))
        aligned = on_even_grids(name, joints, at, signals, numbers)
        limits = None if saturation is None else np.asarray(saturation)
        more = {"saturation": limits, "idle_speed": idle_speed, "slides": slides}
        fields = _by_field(aligned, wrenches) | more
        return cls(name=name, joints=joints, **fields)

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        joints: Annotated[Sequence[str], NOT_EMPTY],
        *,
        mapping: LogMapping | str | Path | None = None,
        name: str = "frame",
    ) -> Log:
        """A log from a table in memory, its columns found as those of a file are.

        Parameters
        ----------
        frame : DataFrame
            Of Polars or pandas, or what else has columns by name: a dictionary of arrays or
            matrices, an array with fields. Times may be dates or durations, and those of pandas
            its index.
        joints : sequence of str
            The m motors.
        mapping : LogMapping or path, optional
            Which columns are what, and their units; by default as their names say, in SI units.

        Raises
        ------
        LogError
            When columns are not found, times do not increase, or too many rows are bad.

        Warns
        -----
        DataWarning
            Of rows that are left out.

        Examples
        --------
        >>> import numpy as np, polars, loopid
        >>> time = np.arange(0, 2, 0.01)
        >>> columns = {"time": time, "crank_joint": np.sin(time), "crank_joint.force": np.cos(time)}
        >>> loopid.Log.from_frame(polars.DataFrame(columns), ["crank_joint"])
        <Log 'frame': 200 samples of crank_joint over 1.99 s in 1 segment>
        """
        from loopid.logs.mapping import mapping_of  # arrays need no models of files

        mapping, joints = mapping_of(mapping), tuple(joints)
        mapping.stream_delays(name, joints, [name])
        columns = _columns_of(frame)
        finder = ColumnFinder(name, {name: tuple(columns)}, mapping)
        ((_, channels),) = finder.channels(mapping.measured(name, joints)).items()
        time = finder.time(name)
        wanted = {*time.names, *(channel.column for channel in channels)}
        table = array_table(name, {one: _cells(columns[one]) for one in columns if one in wanted})
        made = make_streams(name, table, time, tuple(channels))
        streams = [on_joints(stream, mapping.joint_maps) for stream in made]
        return cls.from_streams(name, streams, joints, mapping)

    @classmethod
    def from_streams(
        cls, name: str, streams: Sequence[Stream], joints: tuple[str, ...], mapping: LogMapping
    ) -> Log:
        """A log from streams of signals with time stamps, put on one grid."""
        saturation = None
        if mapping.saturation is not None:
            saturation = np.array(mapping.by_joint(name, "saturation", joints))
        channels = [channel for stream in streams for channel in stream.channels]
        if mapping.static:
            streams = [static_poses(streams)]
        aligned = align(streams, joints)
        log = cls(
            name=name,
            joints=joints,
            **_by_field(aligned, mapping.wrenches),
            saturation=saturation,
            idle_speed=mapping.idle_speed,
            static=mapping.static,
            force_scales={one.joint: one.scale for one in channels if one.quantity == "force"},
            slides={
                f"{one.joint}.{one.quantity}": one.straight
                for one in channels
                if one.straight is not None
            },
        )
        delay = mapping.delay
        if isinstance(delay, Mapping):  # without those of streams
            delay = {joint: delay[joint] for joint in joints if joint in delay}
        return log.delayed(delay)

    def _table(self) -> dict[str, FloatArray]:
        """Columns as ``from_frame`` finds them."""
        quantities = {name: getattr(self, name) for name in QUANTITIES}
        return columns_of(self.joints, self.time, **quantities)

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        count = len(self.parts())
        return (
            f"<Log {self.name!r}: {len(self)} samples of {', '.join(self.joints)} over "
            f"{self.time[-1] - self.time[0]:.2f} s in {count} segment{'s' if count > 1 else ''}>"
        )

    def select(self, good: BoolArray, *dropped: Dropped) -> Log:
        """The samples that a mask (N,) keeps; those that it leaves out divide segments."""
        rows, good = chosen(good, "good", len(self)), np.zeros(len(self), dtype=bool)
        good[rows] = True
        kept: dict[str, Any] = {
            name: values[good]
            for name in ("time", *QUANTITIES)
            if (values := getattr(self, name)) is not None
        }
        poses = self.static  # between which there are no gaps
        kept["segments"] = self.segments[good] if poses else renumbered(self.segments, good)
        kept["wrenches"] = tuple(replace(one, values=one.values[good]) for one in self.wrenches)
        kept["free"] = {joint: values[good] for joint, values in self.free.items()}
        return replace(self, **kept, dropped=(*self.dropped, *dropped))

    def delayed(self, delay: float | Mapping[str, float] | Numbers) -> Log:
        """The log with forces that come late put back to the motion that they belong to.

        Parameters
        ----------
        delay : float, mapping or array
            In s, by which forces of motors are later than positions, of all, by joint, or (m,);
            negative where positions are late.

        Returns
        -------
        Log
            At the same times, but for those at the ends of segments whose forces are not known.

        Raises
        ------
        OptionError
            When a joint is not of the log.
        DataError
            When no segment is longer than the delay.

        Examples
        --------
        >>> import numpy as np, loopid
        >>> time = np.arange(0, 2, 0.01)
        >>> late = loopid.Log.from_arrays(time, np.sin(time), np.sin(time - 0.035), ["crank_joint"])
        >>> log = late.delayed(0.035)
        >>> len(late) - len(log), bool(abs(log.force - log.position).max() < 1e-6)
        (4, True)
        """
        each = _by_joint(delay, self.joints, 0.0) if isinstance(delay, Mapping) else delay
        shifts = for_each(each, "delay", len(self.joints))
        if not shifts.any():
            return self
        force, known = self.force.copy(), np.ones(len(self), dtype=bool)
        for part in self.parts():
            for k in np.flatnonzero(shifts):
                force[part, k], there = _moved(self.force[part, k], shifts[k] * self.rate(part))
                known[part] &= there
        if not known.any():
            raise DataError(f"{self.name}: no segment is longer than the delay", argument="delay")
        if known.all():
            return replace(self, force=force)
        lost = Dropped.at("no force at the corrected time", self.time[~known])
        return replace(self, force=force).select(known, lost)

    def parts(self) -> list[slice]:
        """The samples of each segment, in order."""
        changes = np.flatnonzero(np.diff(self.segments)) + 1
        return [slice(a, b) for a, b in pairwise([0, *changes.tolist(), len(self)])]

    def by_part(
        self, function: Callable[[FloatArray, float], FloatArray], values: FloatArray
    ) -> FloatArray:
        """What a function makes of signals (N, ...) of each segment, and of its rate."""
        values = rectangular(values, "values")
        if values.shape[:1] != self.time.shape:
            said = f"values must have {len(self)} rows, one a sample, not shape {values.shape}"
            raise DataError(said, argument="values")
        return np.concatenate([function(values[part], self.rate(part)) for part in self.parts()])

    @derived
    def step_of(self, joint: str) -> float:
        """Least difference of positions of a motor, in m or rad; 0 where it has none."""
        OptionError.require("motor", joint, self.joints)
        steps = np.diff(np.unique(self.position[:, self.joints.index(joint)]))
        steps = steps[steps > FINEST * steps.sum()]
        return float(steps.min()) if len(steps) else 0.0

    def rate(self, part: slice) -> float:
        """Samples per second of a segment; 0 for a single sample."""
        time = self.time[part]
        return (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else 0.0


def renumbered(segments: IntArray, good: BoolArray) -> IntArray:
    """Numbers from 0 (K,) of the segments (N,) that samples which are left out divide further."""
    new = np.append(True, np.diff(segments) > 0) | np.append(True, ~good[:-1])
    # A segment begins with the first good sample after a change: a bad one begins none.
    return np.asarray(np.cumsum(new & good)[good] - 1, dtype=np.int64)


def _moved(values: FloatArray, steps: float) -> tuple[FloatArray, BoolArray]:
    """Values (N,) from this many steps later, and which there are."""
    from scipy.interpolate import make_interp_spline  # slow to import

    count, at = len(values), np.arange(len(values)) + steps
    nearest = np.clip(np.round(at), 0, count - 1).astype(np.int64)
    known = (at > -WHOLE) & (at < count - 1 + WHOLE)
    if abs(steps - round(steps)) < WHOLE or count <= DEGREE:
        return values[nearest], known
    before = np.clip(np.floor(at), 0, max(count - 2, 0)).astype(np.int64)
    between = make_interp_spline(np.arange(count), values, k=DEGREE)(np.clip(at, 0, count - 1))
    # Values that are clipped or held stay what they are.
    flat = values[before] == values[before + 1]
    return np.where(flat, values[before], between), known


# ---- arrays and tables of others ---------------------------------------------------------------


def _segments(given: ArrayLike, count: int) -> IntArray:
    """Numbers (N,) of segments."""
    numbers = rectangular(given, "segments")
    whole = numbers.shape == (count,) and numbers.dtype.kind in "iu"
    if not whole or (np.diff(numbers) < 0).any():
        said = shown(numbers.tolist())
        message = f"segments must be {count} whole numbers that ascend, not {said}"
        raise DataError(message, argument="segments", given=numbers)
    return numbers.astype(np.int64, copy=False)


def _by_joint(given: Any, joints: Sequence[str], default: Any = None) -> list[Any]:
    """What is given for all or by joint, in the order of the joints."""
    if not isinstance(given, Mapping):
        return [given] * len(joints)
    for name in given:
        OptionError.require("joint", name, joints)
    return [given.get(joint, default) for joint in joints]


def _unit(quantity: str, name: Any) -> Unit:
    """A unit of a quantity; without a name that of SI, of slides or hinges."""
    known = unit_of(quantity, name) if isinstance(name, str) else None
    if name is not None and known is None:
        raise OptionError.unknown(f"unit of the {quantity}", name, unit_names(quantity))
    return known or Unit("", 1.0)


def _by_field(
    aligned: Aligned, wrenches: Sequence[ExternalWrench | WrenchColumns]
) -> dict[str, Any]:
    """What is on the grid as fields of a log, signals of the wrenches in these."""
    found, signals = aligned._asdict(), aligned.signals
    del found["signals"]
    placed = (
        ExternalWrench(one.frame, signals[wrench_name(k)], one.axes, one.about)
        for k, one in enumerate(wrenches)
    )
    found |= {name: signals[name] for name in signals if name in QUANTITIES}
    found.setdefault("force", np.zeros_like(signals["position"]))  # of a commanded motion
    prefix = free_name("")
    free = {n.removeprefix(prefix): signals[n] for n in signals if n.startswith(prefix)}
    return {**found, "wrenches": tuple(placed), "free": free}


def _columns_of(frame: Any) -> dict[str, Any]:
    """Columns by name of a DataFrame, a dictionary, or an array with fields."""
    if hasattr(frame, "collect_schema") and hasattr(frame, "collect"):  # lazy, of Polars
        frame = frame.collect()
    fields = getattr(getattr(frame, "dtype", None), "names", None)
    keys = frame.keys() if isinstance(frame, Mapping) else getattr(frame, "columns", fields)
    if keys is None:
        raise OptionError(
            f"a frame has columns with names, as a DataFrame has, not {type(frame).__name__}",
            given=type(frame).__name__,
        )
    columns = dict[str, Any]()
    for key in keys:
        own = frame[key]
        several = isinstance(own, np.ndarray) and own.ndim == 2
        for name, column in columns_in(str(key), own) if several else [(str(key), own)]:
            if name in columns:
                raise DataError(f"frame has column {name!r} twice, the second in {key}")
            columns[name] = column
    index: Any = getattr(frame, "index", None)
    if hasattr(index, "name"):  # of pandas; numbers of rows have no name
        dates = getattr(getattr(index, "dtype", None), "kind", "") in "mM"
        called = index.name or ("time" if dates else None)
        columns |= {} if called is None or str(called) in columns else {str(called): index}
    return columns


def _cells(column: Any) -> Any:
    """A column as an array (N,) of numbers or times, or as one of Polars."""
    import polars

    if isinstance(column, polars.Series):
        return column
    if getattr(getattr(column, "dtype", None), "tz", None) is not None:  # of pandas
        return np.asarray(column, dtype="datetime64[ns]")
    values = np.ma.filled(column.astype(float), np.nan) if np.ma.is_masked(column) else column
    values = np.asarray(values)
    if values.dtype.kind != "O":
        return values
    missing = ("NAType", "NaTType")  # of pandas
    cells = [None if type(cell).__name__ in missing else cell for cell in values.tolist()]
    return polars.Series(cells, strict=False)
