"""The closures of a mechanism at the poses of its tree; samples last."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.closure_rows import closure_rows
from loopid.kinematics.frame_poses import (
    FrameMotions,
    FramePoses,
    FrameSet,
    frame_motions,
    frame_set,
)
from loopid.kinematics.layout import joint_layout
from loopid.kinematics.pairs import FramePair, PairMotion, PairPose, Rows
from loopid.kinematics.per_mechanism import per_mechanism
from loopid.kinematics.tree import TreeMotion, TreePose, tree_pose
from loopid.mechanism import Mechanism


@dataclass(frozen=True)
class LoopLayout:
    """What is constant of the closures and couplings.

    Attributes
    ----------
    frames : FrameSet
        The closures' frames, two a closure.
    pairs : tuple of FramePair
        Of each closure.
    rows : tuple of tuple
        The rows of each closure, with their places among those of the mechanism.
    couplings : FloatArray
        (k, nv), coefficients of the couplings by velocity index.
    count : int
        Number of all rows; those of the couplings come last.
    """

    frames: FrameSet
    pairs: tuple[FramePair, ...]
    rows: tuple[tuple[tuple[slice, Rows], ...], ...]
    couplings: FloatArray
    count: int


@dataclass(frozen=True)
class LoopPose:
    """All closures at the poses of the tree."""

    mechanism: Mechanism
    tree: TreePose

    @cached_property
    def layout(self) -> LoopLayout:
        """What is constant."""
        return loop_layout(self.mechanism)

    @cached_property
    def poses(self) -> tuple[PairPose, ...]:
        """The pose of each closure's frames."""
        frames = FramePoses(self.tree, self.layout.frames)
        return tuple(PairPose(frames, pair) for pair in self.layout.pairs)

    def residual(self) -> FloatArray:
        """Residual (rows, N): m or rad."""
        residual = self._rows()
        for span, rows, pose in self._closures():
            residual[span] = rows.residual(pose)
        q = self.tree.configurations
        for row, coupling in enumerate(self.mechanism.couplings, self._coupled):
            sums = q[:, list(coupling.q_indices)] @ np.array(coupling.coefficients)
            residual[row] = sums - coupling.offset
        return residual

    def jacobian(self) -> FloatArray:
        """Its derivative by the coordinates (rows, nv, N)."""
        jacobian = self._rows(self.mechanism.model.nv)
        for span, rows, pose in self._closures():
            jacobian[span, pose.pair.columns] = rows.jacobian(pose)
        jacobian[self._coupled :] = self.layout.couplings[:, :, None]
        return jacobian

    def drift(self, motion: TreeMotion) -> FloatArray:
        """Its second derivative by time (rows, N) without accelerations, in a motion."""
        drift = self._rows()  # zero for couplings, which are linear in the coordinates
        if self.poses:
            motions = frame_motions(self.poses[0].poses, motion)
            for span, rows, pose in self._closures():
                drift[span] = rows.drift(pose, pair_motion(motions, pose.pair))
        return drift

    @property
    def _coupled(self) -> int:
        """The first row of a coupling."""
        return self.layout.count - len(self.layout.couplings)

    def _rows(self, *columns: int) -> FloatArray:
        return np.zeros((self.layout.count, *columns, len(self.tree.configurations)))

    def _closures(self) -> Iterator[tuple[slice, Rows, PairPose]]:
        for pose, rows_of_pair in zip(self.poses, self.layout.rows, strict=True):
            for span, rows in rows_of_pair:
                yield span, rows, pose


def loop_pose(mechanism: Mechanism, q: FloatArray) -> LoopPose:
    """Place the closures at configurations (N, nq)."""
    return LoopPose(mechanism, tree_pose(mechanism, q))


def pair_motion(motions: FrameMotions, pair: FramePair) -> PairMotion:
    """How the two frames of a closure move."""
    a, b = pair.a, pair.b
    return PairMotion(
        rate=motions.velocity[:, b] - motions.velocity[:, a],
        acceleration=motions.acceleration[:, b] - motions.acceleration[:, a],
        turn_a=motions.turn[:, a],
        turn_b=motions.turn[:, b],
        turning_a=motions.turning[:, a],
        turning_b=motions.turning[:, b],
    )


@per_mechanism
def loop_layout(mechanism: Mechanism) -> LoopLayout:
    """Find what is constant of a mechanism's closures and couplings."""
    ids = tuple(frame for closure in mechanism.closures for frame in closure.frame_ids)
    frames, ends = frame_set(mechanism, ids), [0]
    coordinates = joint_layout(mechanism).coordinates
    pairs, rows = [], []
    for k, closure in enumerate(mechanism.closures):
        pairs.append(_pair(frames, coordinates, 2 * k, 2 * k + 1))
        spans = []
        for part in closure_rows(closure):
            ends.append(ends[-1] + part.count)
            spans.append((slice(*ends[-2:]), part))
        rows.append(tuple(spans))
    couplings = _coupling_matrix(mechanism)
    return LoopLayout(frames, tuple(pairs), tuple(rows), couplings, ends[-1] + len(couplings))


def _pair(frames: FrameSet, coordinates: IntArray, a: int, b: int) -> FramePair:
    paths = [coordinates[frames.coordinates[frames.spans[k]]] for k in (a, b)]
    columns = np.union1d(*paths)
    at_a, at_b = (np.searchsorted(columns, path) for path in paths)
    return FramePair(a, b, columns, at_a, at_b)


def _coupling_matrix(mechanism: Mechanism) -> FloatArray:
    matrix = np.zeros((len(mechanism.couplings), mechanism.model.nv))
    for row, coupling in zip(matrix, mechanism.couplings, strict=True):
        row[list(coupling.v_indices)] = coupling.coefficients
    return matrix
