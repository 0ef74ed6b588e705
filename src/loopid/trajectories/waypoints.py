"""Point-to-point motion through waypoints, smooth to the acceleration.

Between two waypoints the path parameter runs from 0 to 1 by the polynomial 10 s³ - 15 s⁴ + 6 s⁵,
whose velocity and acceleration vanish at both ends: the motion is C² with holds and turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked, checked_fields
from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError
from loopid.trajectories.motion import Motion, sample_times


@checked_fields
@dataclass(frozen=True)
class Arc:
    """A detour of one coordinate on the way to a waypoint, zero at both ends.

    Attributes
    ----------
    coordinate : str
    height : float
        Value half-way, in m or rad.
    flatness : float
        0 for a parabola h (1 - u²) with u from -1 to 1 along the way; towards 1 the part of an
        ellipse that ends ever steeper, h (sqrt(1 - (f u)²) - sqrt(1 - f²)) / (1 - sqrt(1 - f²)).
    """

    coordinate: str
    height: float
    flatness: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.flatness < 1:
            raise DataError(f"flatness must be in [0, 1), not {self.flatness}")

    def detour(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value and derivatives by the path parameter s in [0, 1]; each (N,)."""
        u, f = 2 * s - 1, self.flatness
        if f == 0:
            return self.height * (1 - u**2), -4 * self.height * u, np.full_like(u, -8 * self.height)
        floor = np.sqrt(1 - f**2)
        scale, root = self.height / (1 - floor), np.sqrt(1 - (f * u) ** 2)
        return scale * (root - floor), -2 * scale * f**2 * u / root, -4 * scale * f**2 / root**3


@checked_fields
@dataclass(frozen=True)
class Waypoint:
    """Where to go next.

    Attributes
    ----------
    position : FloatArray
        (c,) in m or rad.
    seconds : float
        Time of the way there; for the same position as before, a hold.
    arcs : tuple of Arc
    """

    position: FloatArray
    seconds: float
    arcs: tuple[Arc, ...] = ()

    def __post_init__(self) -> None:
        position = finite(self.position, "waypoint")
        if position.ndim != 1:
            raise DataError(f"a waypoint must have shape (c,), not {position.shape}")
        object.__setattr__(self, "position", frozen(position))


@checked
def point_to_point(
    names: Sequence[str], start: FloatArray, waypoints: Sequence[Waypoint], rate: float = 100.0
) -> Motion:
    """Move from a start through waypoints, at rest in each.

    Parameters
    ----------
    names : sequence of str
        The c coordinates.
    start : FloatArray
        (c,).
    waypoints : sequence of Waypoint
    rate : float
        Samples per second.
    """
    stops = [_point(point, len(names)) for point in (start, *(w.position for w in waypoints))]
    ends = np.cumsum([0.0, *(_seconds(waypoint) for waypoint in waypoints)])
    if len(ends) == 1:
        raise DataError("a motion needs at least one waypoint")
    time = sample_times(float(ends[-1]), rate)
    # The way that each sample is on; the last sample ends the last way.
    on = np.minimum(np.searchsorted(ends, time, side="right") - 1, len(waypoints) - 1)
    motion = np.empty((3, len(time), len(names)))
    for k, waypoint in enumerate(waypoints):
        here = np.flatnonzero(on == k)
        fraction = (time[here] - ends[k]) / waypoint.seconds
        way = (stops[k], stops[k + 1])
        motion[:, here] = _way(tuple(names), way, waypoint, np.minimum(fraction, 1.0))
    return Motion(tuple(names), time, *motion)


def _point(values: FloatArray, width: int) -> FloatArray:
    point = finite(values, "waypoint")
    if point.shape != (width,):
        raise DataError(f"a waypoint must have shape ({width},), not {point.shape}")
    return point


def _seconds(waypoint: Waypoint) -> float:
    if not 0 < waypoint.seconds < np.inf:
        raise DataError(f"a way must take a positive time, not {waypoint.seconds} s")
    return waypoint.seconds


def _way(
    names: tuple[str, ...],
    stops: tuple[FloatArray, FloatArray],
    waypoint: Waypoint,
    fraction: FloatArray,
) -> FloatArray:
    """Position, velocity and acceleration (3, N, c) on one way, by the chain rule."""
    s, rate, acceleration = _smooth_step(fraction)
    rate, acceleration = rate / waypoint.seconds, acceleration / waypoint.seconds**2
    by_s = np.zeros((3, len(s), len(names)))
    by_s[0] = stops[0] + s[:, None] * (stops[1] - stops[0])
    by_s[1] = stops[1] - stops[0]
    for arc in waypoint.arcs:
        if arc.coordinate not in names:
            raise DataError(f"arc of unknown coordinate {arc.coordinate!r}: choose among {names}")
        by_s[:, :, names.index(arc.coordinate)] += arc.detour(s)
    position, slope, curvature = by_s
    velocity = slope * rate[:, None]
    return np.stack(
        [position, velocity, slope * acceleration[:, None] + curvature * rate[:, None] ** 2]
    )


def _smooth_step(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Path parameter and its derivatives by the fraction t of the time."""
    value = t**3 * (10 - 15 * t + 6 * t**2)
    return value, 30 * t**2 * (1 - t) ** 2, 60 * t * (1 - t) * (1 - 2 * t)
