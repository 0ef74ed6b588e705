"""Configurations between solved ones, interpolated along what was measured.

Between two nodes with measured values c_A and c_B and unknown coordinates x_A and x_B, the
straight way from c_A to c_B has a curve x(λ) above it, whose ends and end tangents T c' are
known: a cubic Hermite curve. What the measured values are off that way, by curvature or noise,
moves x by the tangent map T, interpolated between the nodes. The error falls with the fourth power
of the distance.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.equations import MeasuredCoordinates
from loopid.kinematics.frames import integrate


class Nodes:
    """Solved samples of a trajectory, and the curves between them.

    Parameters
    ----------
    rows : IntArray
        (n,), increasing numbers of the samples, the first and the last one among them.
    configurations : FloatArray
        (n, nq), NaN where there is no solution.
    values : FloatArray
        (n, c), measured.
    tangent : FloatArray
        (n, u, c), steps of the unknown coordinates by the measured ones.
    """

    def __init__(
        self,
        measured: MeasuredCoordinates,
        rows: IntArray,
        configurations: FloatArray,
        values: FloatArray,
        tangent: FloatArray,
    ) -> None:
        self.measured, self.rows = measured, rows
        self.configurations, self.values, self.tangent = configurations, values, tangent
        # Of each interval: the measured way, the chord, and the tangents at its ends.
        self.way = measured.difference(values[:-1], values[1:])
        self.chord = measured.steps(configurations[:-1], configurations[1:])
        self.begin = (tangent[:-1] @ self.way[:, :, None])[:, :, 0]
        self.end = (tangent[1:] @ self.way[:, :, None])[:, :, 0]

    def at(self, rows: IntArray, values: FloatArray) -> FloatArray:
        """Configurations (N, nq) at samples with measured values (N, c); NaN beside unsolved."""
        if len(self.rows) == 1:
            return self.configurations[np.zeros(len(rows), dtype=np.int64)]
        left = np.searchsorted(self.rows[1:-1], rows, side="right")
        right = left + 1
        part = ((rows - self.rows[left]) / (self.rows[right] - self.rows[left]))[:, None]
        off = self.measured.difference(self.values[left], values) - part * self.way[left]
        tangent = self.tangent[left]
        tangent += part[:, :, None] * (self.tangent[right] - tangent)
        steps = (tangent @ off[:, :, None])[:, :, 0]
        steps += part**2 * (3 - 2 * part) * self.chord[left]
        steps += part * (1 - part) * ((1 - part) * self.begin[left] - part * self.end[left])
        moved = self.measured.tangent(steps)
        return integrate(self.measured.mechanism, self.configurations[left], moved)
