"""The closures of a mechanism at the poses of its tree; samples last."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loopid.arrays import FloatArray
from loopid.kinematics.frame_poses import FrameMotions, FramePoses, frame_motions
from loopid.kinematics.loop_layout import LoopLayout, loop_layout
from loopid.kinematics.pairs import FramePair, PairMotion, PairPose, Rows
from loopid.kinematics.tree import TreeMotion, TreePose, tree_pose
from loopid.robot import Mechanism


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
        for place, rows, pose in self._closures():
            residual[place] = rows.residual(pose)
        q = self.tree.configurations
        for row, coupling in enumerate(self.mechanism.couplings, self._coupled):
            sums = q[:, list(coupling.q_indices)] @ np.array(coupling.coefficients)
            residual[row] = sums - coupling.offset
        return residual

    def jacobian(self) -> FloatArray:
        """Its derivative by the coordinates (rows, nv, N)."""
        jacobian = self._rows(self.mechanism.model.nv)
        for place, rows, pose in self._closures():
            jacobian[place, pose.pair.columns] = rows.jacobian(pose)
        jacobian[self._coupled :] = self.layout.couplings[:, :, None]
        return jacobian

    def drift(self, motion: TreeMotion) -> FloatArray:
        """Its second derivative by time (rows, N) without accelerations, in a motion."""
        drift = self._rows()  # zero for couplings, which are linear in the coordinates
        if self.poses:
            motions = frame_motions(self.poses[0].poses, motion)
            for place, rows, pose in self._closures():
                drift[place] = rows.drift(pose, pair_motion(motions, pose.pair))
        return drift

    @property
    def _coupled(self) -> int:
        """The first row of a coupling."""
        return self.layout.count - len(self.layout.couplings)

    def _rows(self, *columns: int) -> FloatArray:
        return np.zeros((self.layout.count, *columns, len(self.tree.configurations)))

    def _closures(self) -> Iterator[tuple[slice, Rows, PairPose]]:
        for pose, rows_of_pair in zip(self.poses, self.layout.rows, strict=True):
            for place, rows in rows_of_pair:
                yield place, rows, pose


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
