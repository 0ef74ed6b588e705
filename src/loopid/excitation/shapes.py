"""What a designed motion is made of: Fourier series, splines, or poses to stand in.

A shape is linear in its variables: the positions of c coordinates over time are B X with functions
of time B (N, m) and variables X (m, c). All begin and end at rest.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from scipy.linalg import null_space

from loopid.arguments import FloatArray
from loopid.errors import OptionError
from loopid.motion.trajectories import FourierCurve, Motion, SplineCurve, Waypoint, point_to_point
from loopid.records import record
from loopid.registry import Registry

# Samples of the grid: of the shortest period of a series, and between two waypoints or poses.
SAMPLES_OF_PERIOD, SAMPLES_OF_WAY = 12, 8


class Shape(ABC):
    """A kind of motion that takes a time.

    Attributes
    ----------
    seconds : float
    width : int
        Variables of each coordinate.
    samples : int
        Of the grid on which a design looks at the motion.
    """

    seconds: float

    @property
    @abstractmethod
    def width(self) -> int: ...

    @property
    @abstractmethod
    def samples(self) -> int: ...

    @abstractmethod
    def functions(self, time: FloatArray) -> FloatArray:
        """B with its first two derivatives, (3, N, m)."""

    @abstractmethod
    def still(self) -> FloatArray:
        """Variables (m,) of standing at 1 all the time."""

    @abstractmethod
    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random variables (m, count) of a motion about 0 with a size of about 1."""

    @abstractmethod
    def waypoints(self, X: FloatArray) -> tuple[FloatArray, list[Waypoint]]:
        """Start (c,), and ways of a motion file for variables (m, c)."""

    def grid(self) -> FloatArray:
        """Times (N,) at which a design looks at the motion."""
        return np.linspace(0.0, self.seconds, self.samples)

    def motion(self, names: Sequence[str], X: FloatArray, rate: float) -> Motion:
        """The motion of a motion file with these waypoints."""
        start, ways = self.waypoints(X)
        return point_to_point(tuple(names), start, ways, rate=rate)


@record
class FourierShape(Shape):
    """One period of a Fourier series."""

    seconds: float
    harmonics: int

    def __post_init__(self) -> None:
        if self.harmonics < 2:
            raise OptionError(
                f"a series from rest to rest takes 2 harmonics, not {self.harmonics}",
                size=self.harmonics,
            )

    @property
    def width(self) -> int:
        return 2 * self.harmonics - 1

    @property
    def samples(self) -> int:
        return SAMPLES_OF_PERIOD * self.harmonics

    @cached_property
    def _rest(self) -> FloatArray:
        """Shapes (2 H, m - 1) of curves that start at rest."""
        h = np.tile(np.arange(1.0, self.harmonics + 1), 2)
        rows = FourierCurve.at_rest(self.harmonics)
        # Orthonormal with harmonics of equal accelerations counting the same, less the higher.
        return np.asarray(null_space(rows / h) / h[:, None])

    def functions(self, time: FloatArray) -> FloatArray:
        curve = FourierCurve.functions(2 * self.harmonics, time, self.seconds) @ self._rest
        one = np.zeros((3, len(time), 1))
        one[0] = 1.0
        return np.concatenate([one, curve], axis=2)

    def still(self) -> FloatArray:
        return np.asarray(np.eye(self.width)[0])

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        found = generator.normal(size=(self.width, count))
        found[0] = 0.0
        middle = self.functions(self.grid())[0] @ found
        return np.asarray(found / np.abs(middle - middle.mean(axis=0)).max(axis=0))

    def waypoints(self, X: FloatArray) -> tuple[FloatArray, list[Waypoint]]:
        curve = FourierCurve(self._rest @ X[1:])
        return X[0], [Waypoint(X[0], self.seconds, curve=curve)]


@record
class SplineShape(Shape):
    """A spline through a number of waypoints and back to its start."""

    seconds: float
    points: int

    def __post_init__(self) -> None:
        if self.points < 3:
            raise OptionError(f"a spline takes 3 waypoints, not {self.points}", size=self.points)

    @property
    def width(self) -> int:
        return self.points + 1

    @property
    def samples(self) -> int:
        return SAMPLES_OF_WAY * (self.points + 1)

    def functions(self, time: FloatArray) -> FloatArray:
        through = SplineCurve.functions(self.points, time, self.seconds)
        start = -through.sum(axis=2, keepdims=True)
        start[0] += 1.0
        return np.concatenate([start, through], axis=2)

    def still(self) -> FloatArray:
        return np.ones(self.width)

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        return generator.uniform(-1.0, 1.0, size=(self.width, count))

    def waypoints(self, X: FloatArray) -> tuple[FloatArray, list[Waypoint]]:
        curve = SplineCurve(X[1:] - X[0])
        return X[0], [Waypoint(X[0], self.seconds, curve=curve)]


@record
class PosesShape(Shape):
    """Poses to stand in, with the ways between them."""

    seconds: float
    poses: int
    holding: float = 0.5  # part of the time

    def __post_init__(self) -> None:
        if self.poses < 2:
            raise OptionError(f"there must be 2 poses at least, not {self.poses}", size=self.poses)

    @property
    def width(self) -> int:
        return self.poses

    @property
    def samples(self) -> int:
        return SAMPLES_OF_WAY * self.poses

    @property
    def _parts(self) -> tuple[float, float]:
        """Seconds of each hold, and of each of the ways, of which the last one leads back."""
        hold = self.holding * self.seconds / self.poses
        return hold, self.seconds / self.poses - hold

    def functions(self, time: FloatArray) -> FloatArray:
        hold, move = self._parts
        found = np.zeros((3, len(time), self.poses))
        number = np.clip((time // (hold + move)).astype(int), 0, self.poses - 1)
        t = np.clip((time - number * (hold + move) - hold) / move, 0.0, 1.0)
        s = np.stack(
            [
                t**3 * (10 - 15 * t + 6 * t**2),
                30 * t**2 * (1 - t) ** 2 / move,
                60 * t * (1 - t) * (1 - 2 * t) / move**2,
            ]
        )
        rows, ahead = np.arange(len(time)), (number + 1) % self.poses
        found[:, rows, number] -= s
        found[:, rows, ahead] += s
        found[0, rows, number] += 1.0
        return found

    def still(self) -> FloatArray:
        return np.ones(self.poses)

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        return generator.uniform(-1.0, 1.0, size=(self.poses, count))

    def waypoints(self, X: FloatArray) -> tuple[FloatArray, list[Waypoint]]:
        hold, move = self._parts
        ways = []
        for k in range(self.poses):
            ways += [Waypoint(X[k], hold), Waypoint(X[(k + 1) % self.poses], move)]
        return X[0], ways


# By the time and the size.
SHAPES: Registry[Callable[[float, int], Shape]] = Registry(
    "shape", {"fourier": FourierShape, "spline": SplineShape, "poses": PosesShape}
)
