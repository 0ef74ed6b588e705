"""The open tree: joints, their coordinates and limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray, IntArray, frozen
from loopid.errors import OptionError
from loopid.robot.coordinates import coordinate_names, is_sliding


@dataclass(frozen=True)
class Tree:
    """Pinocchio's model under the names of its joints.

    Attributes
    ----------
    name : str
    path : Path
        File it was loaded from.
    model : pinocchio.Model
        The open tree. Never changed after loading.
    """

    name: str
    path: Path
    model: pin.Model

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints of the tree, in Pinocchio's order."""
        return tuple(self.model.names)[1:]

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """A name for each velocity coordinate, the joint's where it has only one."""
        return self.coordinates_of(self.joints)

    def coordinates_of(self, joints: Iterable[str]) -> tuple[str, ...]:
        """Names of the velocity coordinates of some joints."""
        return tuple(part for name in joints for part in coordinate_names(name, self.joint(name)))

    def joint(self, name: str) -> pin.JointModel:
        """Pinocchio's joint of a name.

        Raises
        ------
        OptionError
            Listing the joints.
        """
        if name not in self.joints:
            raise OptionError.unknown("joint", name, self.joints)
        return self.model.joints[self.model.getJointId(name)]

    def velocity_indices(self, names: Iterable[str]) -> IntArray:
        """Positions (k,) in a velocity vector of single coordinates, or of all those of joints."""
        blocks: list[int] = []
        for name in names:
            if name in self.coordinates:
                blocks.append(self.coordinates.index(name))
                continue
            joint = self.joint(name)
            blocks.extend(range(joint.idx_v, joint.idx_v + joint.nv))
        return np.array(blocks, dtype=np.int64)

    def limits(self, name: str) -> tuple[float, float]:
        """Lower and upper limit of a joint with one coordinate, infinite where there is none.

        Limits that are both zero are a placeholder of the file, not limits.
        """
        q = self.joint(name).idx_q
        low, high = self.model.lowerPositionLimit[q], self.model.upperPositionLimit[q]
        if self.joint(name).nq != 1 or low == high == 0:
            return -np.inf, np.inf
        return float(low), float(high)

    @cached_property
    def first_positions(self) -> IntArray:
        """Where in a configuration the joint of each velocity coordinate begins; shape (nv,)."""
        joints = [self.joint(name) for name in self.joints]
        return np.repeat([joint.idx_q for joint in joints], [joint.nv for joint in joints])

    @cached_property
    def position_limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper limits (nq,) of all joints, infinite where there are none."""
        lower, upper = np.full((2, self.model.nq), np.inf)
        lower = -lower
        for name in self.joints:
            q = self.joint(name).idx_q
            if self.joint(name).nq == 1:
                lower[q], upper[q] = self.limits(name)
        return frozen(lower), frozen(upper)

    @property
    def floating(self) -> tuple[str, ...]:
        """Joints of floating bases."""
        kinds = {name: self.joint(name).shortname() for name in self.joints}
        return tuple(name for name, kind in kinds.items() if kind == "JointModelFreeFlyer")

    @cached_property
    def prismatic(self) -> IntArray:
        """Velocity indices of sliding coordinates: in m, all others in rad."""
        sliding = [part for name in self.joints for part in is_sliding(name, self.joint(name))]
        return np.flatnonzero(sliding)
