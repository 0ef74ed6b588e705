"""What a designed motion is made of: Fourier series, or poses to stand in.

A shape is linear in its variables. The positions of c coordinates over time are B X with functions
of time B (N, m) and variables X (m, c). All begin and end at rest.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.linalg import null_space

from loopid.arguments import FloatArray
from loopid.motion.trajectories import (
    FourierCurve,
    Motion,
    Waypoint,
    path_parameter,
    point_to_point,
)
from loopid.records import record
from loopid.registry import Registry


@record
class Shape(ABC):
    """A kind of motion that takes a time."""

    seconds: float
    size: int  # harmonics or poses

    samples: ClassVar[int]  # of the grid, for each harmonic or pose

    @abstractmethod
    def functions(self, time: FloatArray) -> FloatArray:
        """B with its first two derivatives, (3, N, m)."""

    @abstractmethod
    def waypoints(self, X: FloatArray) -> tuple[FloatArray, list[Waypoint]]:
        """Start (c,), and ways of a motion file for variables (m, c)."""

    def still(self) -> FloatArray:
        """Variables (m,) of standing at 1 all the time."""
        return np.ones(self.functions(np.zeros(1)).shape[2])

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Random variables (m, count) of a motion about 0 with a size of about 1."""
        return generator.uniform(-1.0, 1.0, size=(len(self.still()), count))

    def grid(self) -> FloatArray:
        """Times (N,) at which a design looks at the motion."""
        return np.linspace(0.0, self.seconds, self.samples * self.size)

    def motion(self, names: Sequence[str], X: FloatArray, rate: float) -> Motion:
        """The motion of a motion file with these waypoints."""
        start, ways = self.waypoints(X)
        return point_to_point(tuple(names), start, ways, rate=rate)


class FourierShape(Shape):
    """One period of a Fourier series."""

    samples = 12

    @cached_property
    def _rest(self) -> FloatArray:
        """Shapes (2 H, m - 1) of curves that start at rest."""
        h = np.tile(np.arange(1.0, self.size + 1), 2)
        # Orthonormal with harmonics of equal accelerations counting the same, less the higher.
        return np.asarray(null_space(FourierCurve.at_rest(self.size) / h) / h[:, None])

    def functions(self, time: FloatArray) -> FloatArray:
        curve = FourierCurve.functions(2 * self.size, time, self.seconds) @ self._rest
        one = np.zeros((3, len(time), 1))
        one[0] = 1.0
        return np.concatenate([one, curve], axis=2)

    def still(self) -> FloatArray:
        return np.asarray(np.eye(2 * self.size - 1)[0])

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        found = generator.normal(size=(2 * self.size - 1, count))
        found[0] = 0.0
        middle = self.functions(self.grid())[0] @ found
        return np.asarray(found / np.abs(middle - middle.mean(axis=0)).max(axis=0))

    def waypoints(self, X: FloatArray) -> tuple[FloatArray, list[Waypoint]]:
        return X[0], [Waypoint(X[0], self.seconds, curve=FourierCurve(self._rest @ X[1:]))]


class PosesShape(Shape):
    """Poses to stand in half of the time, with the ways between them."""

    samples = 8

    def functions(self, time: FloatArray) -> FloatArray:
        hold = move = self.seconds / self.size / 2
        found = np.zeros((3, len(time), self.size))
        number = np.clip((time // (hold + move)).astype(int), 0, self.size - 1)
        t = np.clip((time - number * (hold + move) - hold) / move, 0.0, 1.0)
        s = path_parameter(t, move)
        rows, ahead = np.arange(len(time)), (number + 1) % self.size
        found[:, rows, number] -= s
        found[:, rows, ahead] += s
        found[0, rows, number] += 1.0
        return found

    def waypoints(self, X: FloatArray) -> tuple[FloatArray, list[Waypoint]]:
        seconds = self.seconds / self.size / 2
        ways = [(X[k], X[(k + 1) % self.size]) for k in range(self.size)]
        return X[0], [Waypoint(end, seconds) for way in ways for end in way]


# By the time and the size.
SHAPES: Registry[Callable[[float, int], Shape]] = Registry(
    "shape", {"fourier": FourierShape, "poses": PosesShape}
)
