"""The chain of samples, each reached from the last one that was: exact where links are in doubt."""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.kinematics.equations import MeasuredCoordinates
from loopid.kinematics.links import Linked
from loopid.kinematics.path_following import Assembly, PathOptions, follow_paths

SAME = 1e-6  # rad or characteristic lengths: other solutions are farther away


class Chain:
    """Candidates for the samples of a trajectory, until each follows from those before.

    Row 0 is the start. A row is *sure* when following the path from the last solved row before it
    leads to what the row holds: a configuration, or none. If all rows are sure, then by induction
    they are what following the path sample by sample gives.
    """

    def __init__(
        self,
        measured: MeasuredCoordinates,
        start: FloatArray,
        targets: FloatArray,
        candidates: Linked,
        options: PathOptions,
    ) -> None:
        self.measured, self.options = measured, options
        self.targets = np.concatenate([measured.read(start[None]), targets])
        self.q = np.concatenate([start[None], candidates.configurations])
        self.gap = np.concatenate([[0.0], candidates.residual])
        self.sure = np.concatenate([[True], candidates.follows])

    def followed(self) -> Assembly:
        """The samples, up to one whose candidate turned out to be on another branch."""
        while not self.sure.all():
            self._test(np.flatnonzero(~self.sure))
        return Assembly(self.q[1:], self.gap[1:], self._found()[1:])

    def _found(self) -> BoolArray:
        return np.asarray(~np.isnan(self.q).any(axis=1), dtype=bool)

    def _previous(self) -> IntArray:
        """The last solved row before each row."""
        rows = np.arange(len(self.q))
        last = np.maximum.accumulate(np.where(self._found(), rows, 0))
        return np.asarray(np.append(0, last[:-1]), dtype=np.int64)

    def _test(self, rows: IntArray) -> None:
        """Follow the path to rows; what differs from what they hold replaces it."""
        before, found = self._previous(), self._found()
        reached = follow_paths(
            self.measured, self.q[before[rows]], self.targets[rows], self.options
        )
        q = reached.configurations
        both = found[rows] & reached.assembled
        apart = np.zeros(len(rows))
        apart[both] = self._apart(self.q[rows[both]], q[both])
        differs = (found[rows] != reached.assembled) | (apart > SAME)
        self.sure[rows] = True
        changed = rows[differs]
        self.q[changed], self.gap[changed] = q[differs], reached.residual[differs]
        lost = rows[~reached.assembled]
        self.gap[lost] = reached.residual[~reached.assembled]
        after = self._previous()
        self.sure &= (after == before) & ~np.isin(after, changed)
        self.sure[0] = True
        elsewhere = rows[apart > SAME]
        if len(elsewhere):
            self._cut(int(elsewhere[0]) + 1)

    def _apart(self, one: FloatArray, other: FloatArray) -> FloatArray:
        steps = self.measured.steps(one, other)
        return np.asarray(np.abs(steps).max(axis=1, initial=0.0), dtype=np.float64)

    def _cut(self, length: int) -> None:
        self.q, self.gap, self.sure = self.q[:length], self.gap[:length], self.sure[:length]
        self.targets = self.targets[:length]
