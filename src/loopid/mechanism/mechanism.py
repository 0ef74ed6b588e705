"""The robot: a tree, the closures of its loops, and the joints that have motors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray, IntArray, frozen
from loopid.errors import OptionError
from loopid.mechanism.closure import LoopClosure
from loopid.mechanism.platform import Platform
from loopid.parameters import KINDS, ParameterSet, model_kinds


@dataclass(frozen=True)
class Body:
    """A rigid body that carries parameters: all the links fixed to one joint.

    Attributes
    ----------
    link : str
        The link that the joint carries; the parameters are in its frame.
    joint_id : int
        Index of the joint in the Pinocchio model.
    """

    link: str
    joint_id: int


@dataclass(frozen=True)
class Mechanism:
    """A robot with or without closed loops.

    Attributes
    ----------
    name : str
    path : Path
        File it was loaded from.
    model : pinocchio.Model
        The open tree. Never changed after loading.
    closures : tuple of LoopClosure
    actuated : tuple of str
        Joints with motors, in the order of the projected rows.
    bodies : tuple of Body
        Bodies with an inertial, in the order of the file's links.
    reference : FloatArray
        A closed configuration, shape (nq,), read-only.
    platform : Platform or None
    """

    name: str
    path: Path
    model: pin.Model
    closures: tuple[LoopClosure, ...]
    actuated: tuple[str, ...]
    bodies: tuple[Body, ...]
    reference: FloatArray
    platform: Platform | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "reference", frozen(self.reference))

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints of the tree, in Pinocchio's order."""
        return tuple(self.model.names)[1:]

    @property
    def passive(self) -> tuple[str, ...]:
        """Joints without motors."""
        return tuple(joint for joint in self.joints if joint not in self.actuated)

    @property
    def rows(self) -> int:
        """Number of scalar closure equations, redundant ones included."""
        return sum(closure.rows for closure in self.closures)

    def velocity_indices(self, joints: Iterable[str]) -> IntArray:
        """Positions of the joints' coordinates in a velocity vector; shape (k,)."""
        blocks: list[int] = []
        for name in joints:
            joint = self.joint(name)
            blocks.extend(range(joint.idx_v, joint.idx_v + joint.nv))
        return np.array(blocks, dtype=np.int64)

    def limits(self, name: str) -> tuple[float, float]:
        """Lower and upper limit of a joint with one coordinate, infinite where there is none."""
        q = self.joint(name).idx_q
        if self.joint(name).nq != 1:
            return -np.inf, np.inf
        model = self.model
        return float(model.lowerPositionLimit[q]), float(model.upperPositionLimit[q])

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

    def parameters(self, model: str = "full") -> ParameterSet:
        """Standard parameters of all bodies in ``"gravity"`` or ``"full"`` form."""
        return ParameterSet.of_links((body.link for body in self.bodies), model_kinds(model))

    def standard_parameters(self, model: str = "full") -> FloatArray:
        """Values from the robot file in the order of ``parameters(model)``; shape (n,)."""
        width = len(model_kinds(model))
        inertias = [self.model.inertias[body.joint_id] for body in self.bodies]
        return np.concatenate([inertia.toDynamicParameters()[:width] for inertia in inertias])

    def columns(self, model: str = "full") -> IntArray:
        """Columns of Pinocchio's tree regressor that ``parameters(model)`` occupy; shape (n,)."""
        width = len(model_kinds(model))
        first = len(KINDS) * (np.array([body.joint_id for body in self.bodies]) - 1)
        return (first[:, None] + np.arange(width)).ravel()

    @cached_property
    def prismatic(self) -> IntArray:
        """Velocity indices of prismatic joints: coordinates in m, all others in rad."""
        names = [
            name
            for name, joint in zip(self.joints, list(self.model.joints)[1:], strict=True)
            if joint.shortname().startswith("JointModelP")
            and not joint.shortname().startswith("JointModelPlanar")
        ]
        return self.velocity_indices(names)

    @cached_property
    def length(self) -> float:
        """Characteristic length in m: the widest distance between joints at the reference."""
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, self.reference)
        points = np.array([placement.translation for placement in list(data.oMi)[1:]])
        spread = np.linalg.norm(points[:, None] - points[None], axis=2)
        return float(spread.max()) or 1.0
