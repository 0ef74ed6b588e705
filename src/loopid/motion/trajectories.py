"""Motions of some coordinates: sampled, periodic, from waypoint to waypoint, and smooth detours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from loopid.arguments import MOST_SAMPLES, FloatArray, Positive, checked, finite, shaped, times
from loopid.errors import DataError
from loopid.numbers import SUM_ROUND_OFF
from loopid.records import Tabular, columns_of, record

# Rate and acceleration at the ends, as parts of the largest terms, that count as rest.
REST = 1e-9
DERIVATIVES = "position", "velocity", "acceleration"


@record(checked=True)
class Motion(Tabular):
    """Coordinates over time, with their first two derivatives.

    Examples
    --------
    >>> import loopid
    >>> there = loopid.motion.Waypoint([0.3], seconds=2.0)
    >>> motion = loopid.motion.point_to_point(["crank_joint"], [0.0], [there], rate=10)
    >>> motion.time.shape, motion.position[-1].round(6).tolist()
    ((21,), [0.3])
    """

    names: tuple[str, ...]  # the c coordinates: joints, or those of the platform
    time: FloatArray  # (N,) in s, increasing
    position: FloatArray  # (N, c) in m or rad, and per s and s²; read-only
    velocity: FloatArray
    acceleration: FloatArray

    def __post_init__(self) -> None:
        time = times(self.time)
        object.__setattr__(self, "time", time)
        for name in DERIVATIVES:
            values = shaped(getattr(self, name), name, len(time), len(self.names))
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        return f"<Motion of {', '.join(self.names)}: {len(self)} samples, {self.duration:g} s>"

    def _table(self) -> dict[str, FloatArray]:
        quantities = {name: getattr(self, name) for name in DERIVATIVES}
        return columns_of(self.names, self.time, **quantities)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.time[-1] - self.time[0])


def _sample_times(duration: float, rate: float) -> FloatArray:
    """Times from 0 to a duration (s) at a rate (Hz), both ends included."""
    for name, given, unit in (("duration", duration, "s"), ("rate", rate, "Hz")):
        if not 0 < given < np.inf:
            said = f"{name} must be a number of {unit} above 0, not {given:g}"
            raise DataError(said, argument=name, given=given)
    if not duration * rate < MOST_SAMPLES:
        raise DataError(
            f"{duration:g} s at {rate:g} Hz are {duration * rate:.3g} samples, more than the "
            f"{MOST_SAMPLES:,} that a motion may have"
        )
    steps = int(np.floor(duration * rate * (1 + SUM_ROUND_OFF)))
    return np.arange(steps + 1) / rate


@record(checked=True)
class FourierCurve:
    """A detour of c coordinates that leaves a pose at rest and comes back at rest [Swevers1997].

    Σ_h sine_h sin(h ω t) + cosine_h (cos(h ω t) - 1) with ω = 2π / T of a time T.
    """

    # (2 H, c): sine_1 ... sine_H, then cosine_1 ... cosine_H. It starts and ends at rest, as
    # Σ h sine_h = 0 and Σ h² cosine_h = 0.
    shape: FloatArray

    def __post_init__(self) -> None:
        shape = finite(self.shape, "shape of a curve")
        if shape.ndim != 2 or not shape.size:
            raise DataError(f"the shape of a curve must be (functions, c), not {shape.shape}")
        if len(shape) % 2:
            raise DataError("a Fourier curve has as many sines as cosines")
        object.__setattr__(self, "shape", shape)
        terms = self.at_rest(len(self.shape) // 2)
        off = np.abs(terms @ self.shape)
        if (off > REST * (np.abs(terms).sum(axis=0) @ np.abs(self.shape))).any():
            raise DataError(
                "a Fourier curve must start at rest: for each coordinate the sums of h sine_h and "
                "of h² cosine_h must be zero"
            )

    @staticmethod
    def functions(count: int, time: FloatArray, seconds: float) -> FloatArray:
        """``count`` sines and cosines and their derivatives, (3, N, count) at times (N,)."""
        omega = 2 * np.pi / seconds * np.arange(1, count // 2 + 1)
        sine, cosine = np.sin(np.outer(time, omega)), np.cos(np.outer(time, omega))
        position = np.concatenate([sine, cosine - 1], axis=1)
        rate = np.concatenate([omega * cosine, -omega * sine], axis=1)
        second = np.concatenate([-(omega**2) * sine, -(omega**2) * cosine], axis=1)
        return np.stack([position, rate, second])

    def detour(self, time: FloatArray, seconds: float) -> FloatArray:
        """Position off the start, rate and acceleration (3, N, c) at times (N,) of this many s."""
        return self.functions(len(self.shape), time, seconds) @ self.shape

    def backwards(self) -> FourierCurve:
        """The same curve, from its end to its start."""
        sines = len(self.shape) // 2
        return FourierCurve(np.concatenate([-self.shape[:sines], self.shape[sines:]]))

    @staticmethod
    def at_rest(harmonics: int) -> FloatArray:
        """Rows (2, 2 H) that a shape must be orthogonal to."""
        h, zero = np.arange(1.0, harmonics + 1), np.zeros(harmonics)
        return np.stack([np.append(h, zero), np.append(zero, h**2)])


@record(checked=True)
class Arc:
    """A detour of one coordinate on the way to a waypoint, zero at both ends."""

    coordinate: str
    height: float  # value half-way, in m or rad
    # 0 for a parabola h (1 - u²) with u from -1 to 1 along the way; towards 1 the part of an
    # ellipse that ends ever steeper, h (sqrt(1 - (f u)²) - sqrt(1 - f²)) / (1 - sqrt(1 - f²))
    flatness: Annotated[float, Field(ge=0, lt=1)] = 0.0

    def detour(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value and derivatives by the path parameter s in [0, 1]; each (N,)."""
        u, f = 2 * s - 1, self.flatness
        if f == 0:
            return self.height * (1 - u**2), -4 * self.height * u, np.full_like(u, -8 * self.height)
        floor = np.sqrt(1 - f**2)
        scale, root = self.height / (1 - floor), np.sqrt(1 - (f * u) ** 2)
        return scale * (root - floor), -2 * scale * f**2 * u / root, -4 * scale * f**2 / root**3


@record(checked=True)
class Waypoint:
    """Where to go next.

    Attributes
    ----------
    position : FloatArray
        (c,) in m or rad.
    seconds : float
        Time of the way there; for the same position as before, a hold.
    arcs : tuple of Arc
    curve : FourierCurve, optional
        A detour of all coordinates, zero at both ends, that takes the same time.

    Examples
    --------
    >>> import loopid
    >>> loopid.motion.Waypoint([0.2, 0.6], seconds=2.0).position.shape
    (2,)
    """

    position: FloatArray
    seconds: Positive
    arcs: tuple[Arc, ...] = ()
    curve: FourierCurve | None = None

    def __post_init__(self) -> None:
        position = finite(self.position, "waypoint")
        if position.ndim != 1:
            raise DataError(f"a waypoint must have shape (c,), not {position.shape}")
        object.__setattr__(self, "position", position)


@checked
def point_to_point(
    names: Sequence[str], start: FloatArray, waypoints: Sequence[Waypoint], *, rate: float = 100.0
) -> Motion:
    """Move from a start through waypoints, at rest in each.

    Between two waypoints the path parameter runs from 0 to 1 by the polynomial 10 t³ - 15 t⁴ + 6
    t⁵. Its velocity and acceleration vanish at both ends. So the motion is C² with holds and turns.

    Parameters
    ----------
    names : sequence of str
        The c coordinates.
    start : FloatArray
        (c,) in m or rad.
    waypoints : sequence of Waypoint
    rate : float
        Samples per second.

    Returns
    -------
    Motion

    Raises
    ------
    DataError
        When a waypoint has another shape, takes no time, or has an arc of another coordinate.

    Examples
    --------
    >>> import loopid
    >>> there = loopid.motion.Waypoint([1.0], seconds=2.0)
    >>> motion = loopid.motion.point_to_point(["crank_joint"], [0.0], [there], rate=50)
    >>> motion
    <Motion of crank_joint: 101 samples, 2 s>
    >>> bool(abs(motion.velocity.max() - 1.875 * 0.5) < 1e-12)  # 1.875 times the average
    True
    """
    stops = _stops(names, start, waypoints)
    ends = np.cumsum([0.0, *(waypoint.seconds for waypoint in waypoints)])
    time = _sample_times(float(ends[-1]), rate)
    # The way that each sample is on; the last sample ends the last way.
    on = np.minimum(np.searchsorted(ends, time, side="right") - 1, len(waypoints) - 1)
    motion = np.empty((3, len(time), len(names)))
    for k, waypoint in enumerate(waypoints):
        here = np.flatnonzero(on == k)
        part = np.minimum((time[here] - ends[k]) / waypoint.seconds, 1.0)
        motion[:, here] = _on_way(names, stops[k], stops[k + 1], waypoint, part)
    return Motion(tuple(names), time, *motion)


def _stops(
    names: Sequence[str], start: FloatArray, waypoints: Sequence[Waypoint]
) -> list[FloatArray]:
    """The start and all waypoints (c,), which fit the coordinates and each other."""
    if not waypoints:
        raise DataError("a motion needs at least one waypoint")
    points = start, *(waypoint.position for waypoint in waypoints)
    stops = [shaped(point, "a waypoint", len(names)) for point in points]
    for waypoint in waypoints:
        if waypoint.curve is not None and waypoint.curve.shape.shape[1] != len(names):
            raise DataError(f"a curve must have a shape (functions, {len(names)})")
        for arc in waypoint.arcs:
            if arc.coordinate not in names:
                raise DataError(
                    f"arc of unknown coordinate {arc.coordinate!r}: choose among "
                    f"{', '.join(names)}",
                    given=arc.coordinate,
                    valid=tuple(names),
                )
    return stops


def path_parameter(t: FloatArray, seconds: float) -> FloatArray:
    """10 t³ - 15 t⁴ + 6 t⁵, rate and acceleration (3, N) at parts t (N,) of the time of a way."""
    s = t**3 * (10 - 15 * t + 6 * t**2)
    rate, second = 30 * t**2 * (1 - t) ** 2, 60 * t * (1 - t) * (1 - 2 * t)
    return np.stack([s, rate / seconds, second / seconds**2])


def _on_way(
    names: Sequence[str], start: FloatArray, end: FloatArray, waypoint: Waypoint, t: FloatArray
) -> FloatArray:
    """Positions, velocities and accelerations (3, N, c) at parts t (N,) of the time of a way."""
    s, ds, dds = path_parameter(t, waypoint.seconds)
    position = start + s[:, None] * (end - start)
    slope = np.broadcast_to(end - start, position.shape).copy()
    curvature = np.zeros_like(position)
    for arc in waypoint.arcs:
        for part, detour in zip((position, slope, curvature), arc.detour(s), strict=True):
            part[:, names.index(arc.coordinate)] += detour
    # By the chain rule.
    acceleration = slope * dds[:, None] + curvature * ds[:, None] ** 2
    motion = np.stack([position, slope * ds[:, None], acceleration])
    if waypoint.curve is not None:
        motion += waypoint.curve.detour(t * waypoint.seconds, waypoint.seconds)
    return motion


@record(checked=True)
class FourierSeries:
    """x_i(t) = offset_i + Σ_h sine_ih sin(h ω t) + cosine_ih cos(h ω t) [Swevers1997].

    Attributes
    ----------
    names : tuple of str
        The c coordinates.
    frequency : float
        Of the first harmonic, ω / 2π in Hz.
    offset : FloatArray
        (c,) in m or rad.
    sine, cosine : FloatArray
        (c, harmonics) in m or rad.

    Examples
    --------
    >>> import loopid
    >>> crank, sine, cosine = ("crank_joint",), [[0.2, 0.1]], [[0.0, 0.1]]
    >>> series = loopid.motion.FourierSeries(crank, 0.5, [1.0], sine, cosine)
    >>> series.motion(rate=50)
    <Motion of crank_joint: 101 samples, 2 s>
    """

    names: tuple[str, ...]
    frequency: Positive
    offset: FloatArray
    sine: FloatArray
    cosine: FloatArray

    def __post_init__(self) -> None:
        harmonics = np.shape(self.sine)[1:2] or (1,)
        for name, more in (("offset", ()), ("sine", harmonics), ("cosine", harmonics)):
            values = shaped(getattr(self, name), name, len(self.names), *more)
            object.__setattr__(self, name, values)

    @property
    def period(self) -> float:
        """Seconds after which the motion repeats."""
        return 1.0 / self.frequency

    def motion(self, duration: float | None = None, rate: float = 100.0) -> Motion:
        """Sample the series, by default over one period (duration in s, rate in Hz)."""
        time = _sample_times(self.period if duration is None else duration, rate)
        shape = np.concatenate([self.sine.T, self.cosine.T])
        off, velocity, second = FourierCurve.functions(len(shape), time, self.period) @ shape
        position = self.offset + self.cosine.sum(axis=1) + off
        return Motion(self.names, time, position, velocity, second)
