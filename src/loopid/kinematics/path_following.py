"""Following a branch of closed configurations to measured coordinates.

The measured coordinates move from those of the start to the targets along a straight line, in
steps whose length adapts so that Newton's method contracts at once and the Jacobian keeps its
orientation: the solution then stays on the assembly branch of the start [Allgower2003]. All
samples advance together, each with its own step; every linear solve is batched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.errors import OptionError
from loopid.kinematics.equations import MeasuredCoordinates
from loopid.kinematics.newton import (
    CONTRACTION,
    NEWTON_STEPS,
    SHORT,
    contracts,
    newton_step,
)
from loopid.kinematics.step_solves import LONGEST_STEP, same_side

CLOSURE_TOLERANCE = 1e-10  # m; what an assembled configuration must reach
SHORTEST_PATH_STEP = 2.0**-12
BATCH = 1536  # samples solved together: more would crowd the cache


@dataclass(frozen=True)
class Assembly:
    """Assembled configurations.

    Attributes
    ----------
    configurations : FloatArray
        (N, nq); rows that could not be assembled hold NaN.
    residual : FloatArray
        (N,), largest closure residual in m.
    assembled : BoolArray
        (N,), whether the loops close to the tolerance on the start's branch.
    """

    configurations: FloatArray
    residual: FloatArray
    assembled: BoolArray

    @classmethod
    def joined(cls, parts: list[Assembly]) -> Assembly:
        """Assemblies one after the other."""
        fields = [(part.configurations, part.residual, part.assembled) for part in parts]
        return cls(*(np.concatenate(rows) for rows in zip(*fields, strict=True)))


@dataclass(frozen=True)
class PathOptions:
    """How exactly, and with which steps at least, paths are followed.

    Attributes
    ----------
    tolerance : float
        Closure residual to reach, in m.
    shortest_step : float
        Part of the way below which a sample is given up.
    """

    tolerance: float = CLOSURE_TOLERANCE
    shortest_step: float = SHORTEST_PATH_STEP

    def __post_init__(self) -> None:
        if not 0 <= self.tolerance < np.inf:
            raise OptionError(f"tolerance must be a length from 0 on, not {self.tolerance} m")
        if not 0 < self.shortest_step <= 1:
            raise OptionError(f"shortest_step must be in (0, 1], not {self.shortest_step}")


def follow_paths(
    measured: MeasuredCoordinates, q: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    """Move all samples (N, nq) along their straight lines to the targets (N, c)."""
    parts = [
        _follow(measured, q[first : first + BATCH], targets[first : first + BATCH], options)
        for first in range(0, max(len(q), 1), BATCH)
    ]
    return Assembly.joined(parts)


def closes(
    measured: MeasuredCoordinates, q: FloatArray, targets: FloatArray, options: PathOptions
) -> tuple[FloatArray, BoolArray]:
    """Closure gaps (N,) in m, and where they are small enough."""
    gap = measured.closure_gap(q, targets)
    small = gap <= max(options.tolerance, 2.0 * measured.mechanism.closure_gap)
    return gap, np.asarray(small, dtype=bool)


def _follow(
    measured: MeasuredCoordinates, start: FloatArray, targets: FloatArray, options: PathOptions
) -> Assembly:
    paths = _Paths(measured, start, targets, options.shortest_step)
    while len(paths.underway):
        paths.advance()
    q = measured.write(paths.reached, targets)
    gap, small = closes(measured, q, targets, options)
    assembled = (paths.done >= 1.0) & small
    return Assembly(np.where(assembled[:, None], q, np.nan), gap, assembled)


class _Paths:
    """Samples underway to their targets.

    Each is in its own step along the path, and within it in its own step of Newton's method, so
    that none waits for the others.
    """

    def __init__(
        self,
        measured: MeasuredCoordinates,
        start: FloatArray,
        targets: FloatArray,
        shortest_step: float,
    ) -> None:
        self.measured, self.shortest_step = measured, shortest_step
        self.origin = measured.read(start)
        self.way = measured.difference(self.origin, targets)
        # The last point on the path, the part of the way done there, and the next one tried.
        self.reached, self.done, self.step = start.copy(), np.zeros(len(start)), np.ones(len(start))
        self.jacobian = measured.linearise(start, self.origin).unknown
        self.q, self.goal = start.copy(), self.origin.copy()
        self.longest, self.left = np.zeros(len(start)), np.zeros(len(start), dtype=np.int64)
        self.underway = np.arange(len(start))
        self._set_out(self.underway)

    def _set_out(self, k: IntArray) -> None:
        """Try the next point of some samples."""
        ahead = np.minimum(self.done[k] + self.step[k], 1.0)
        self.goal[k] = self.origin[k] + ahead[:, None] * self.way[k]
        self.q[k] = self.measured.write(self.reached[k], self.goal[k])
        self.longest[k], self.left[k] = LONGEST_STEP, NEWTON_STEPS

    def advance(self) -> None:
        """One step of Newton's method; samples that arrive or fail by it set out again."""
        k = self.underway
        self.q[k], length, jacobian, *_ = newton_step(self.measured, self.q[k], self.goal[k])
        good = contracts(length, self.longest[k])
        self.longest[k] = CONTRACTION * length
        self.left[k] -= 1
        there, lost = good & (length <= SHORT), ~good | (self.left[k] == 0)
        settled = there | lost
        there[there] = same_side(self.jacobian[k[there]], jacobian[there])
        arrived = k[there]
        self.done[arrived] = np.minimum(self.done[arrived] + self.step[arrived], 1.0)
        self.reached[arrived], self.jacobian[arrived] = self.q[arrived], jacobian[there]
        self.step[k[settled]] *= np.where(there[settled], 2.0, 0.5)
        ends = (self.done[k] >= 1.0) | (self.step[k] < self.shortest_step)
        self._set_out(k[settled & ~ends])
        self.underway = k[~(settled & ends)]
