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
from loopid.mechanism.closure import JointCoupling, LoopClosure
from loopid.mechanism.coordinates import coordinate_names, is_sliding
from loopid.mechanism.identical import LinkGroup, tie_indices, tied_names
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
        Joints with motors.
    bodies : tuple of Body
        Bodies with an inertial, in the order of the file's links.
    reference : FloatArray
        A closed configuration, shape (nq,), read-only.
    platform : Platform or None
    couplings : tuple of JointCoupling
    free : tuple of str
        Passive coordinates that the motors leave free: "= 0" is what their rows read.
    redundant : tuple of str
        Actuated coordinates that follow from the others: redundant actuation.
    identical : tuple of LinkGroup
        Links declared alike.
    tied : bool
        Whether links declared alike share their parameters.
    closure_gap : float
        Residual in m that is left at the reference, where the file's numbers are rounded.
    """

    name: str
    path: Path
    model: pin.Model
    closures: tuple[LoopClosure, ...]
    actuated: tuple[str, ...]
    bodies: tuple[Body, ...]
    reference: FloatArray
    platform: Platform | None = None
    couplings: tuple[JointCoupling, ...] = ()
    free: tuple[str, ...] = ()
    redundant: tuple[str, ...] = ()
    identical: tuple[LinkGroup, ...] = ()
    tied: bool = False
    closure_gap: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "reference", frozen(self.reference))

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

    @property
    def independent(self) -> tuple[str, ...]:
        """Coordinates that determine the motion, in the order of the projected rows.

        Those of the actuated joints but for redundant ones, then the free ones.
        """
        driven = self.coordinates_of(self.actuated)
        return (*(name for name in driven if name not in self.redundant), *self.free)

    @property
    def measured(self) -> tuple[str, ...]:
        """Independent coordinates that are joints of their own: enough to know where it is."""
        return tuple(name for name in self.independent if name in self.joints)

    @property
    def passive(self) -> tuple[str, ...]:
        """Joints without motors."""
        return tuple(joint for joint in self.joints if joint not in self.actuated)

    @property
    def floating(self) -> tuple[str, ...]:
        """Joints of floating bases."""
        kinds = {name: self.joint(name).shortname() for name in self.joints}
        return tuple(name for name, kind in kinds.items() if kind == "JointModelFreeFlyer")

    @property
    def rows(self) -> int:
        """Number of scalar closure equations, redundant ones and couplings included."""
        return len(self.row_names)

    @property
    def row_names(self) -> tuple[str, ...]:
        """The closure or coupling that each scalar equation belongs to."""
        loops = (closure.name for closure in self.closures for _ in range(closure.rows))
        return (*loops, *(coupling.name for coupling in self.couplings))

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
    def position_limits(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper limits (nq,) of all joints, infinite where there are none."""
        lower, upper = np.full((2, self.model.nq), np.inf)
        lower = -lower
        for name in self.joints:
            q = self.joint(name).idx_q
            if self.joint(name).nq == 1:
                lower[q], upper[q] = self.limits(name)
        return frozen(lower), frozen(upper)

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
        return ParameterSet.of_links(tied_names(self.links, self.ties), model_kinds(model))

    def standard_parameters(self, model: str = "full") -> FloatArray:
        """Values from the robot file in the order of ``parameters(model)``; shape (n,).

        Links that are tied take the mean of their values.
        """
        width = len(model_kinds(model))
        inertias = [self.model.inertias[body.joint_id] for body in self.bodies]
        values = np.array([inertia.toDynamicParameters()[:width] for inertia in inertias])
        place = tie_indices(self.links, self.ties)
        tied = [values[place == k].mean(axis=0) for k in range(place.max() + 1)]
        return np.concatenate(tied)

    @property
    def links(self) -> tuple[str, ...]:
        """Links that name the bodies with parameters."""
        return tuple(body.link for body in self.bodies)

    @property
    def ties(self) -> tuple[LinkGroup, ...]:
        """The groups of links that share their parameters."""
        return self.identical if self.tied else ()

    def columns(self, model: str = "full") -> IntArray:
        """Columns of Pinocchio's tree regressor that the bodies occupy; shape (n,)."""
        width = len(model_kinds(model))
        first = len(KINDS) * (np.array([body.joint_id for body in self.bodies]) - 1)
        return (first[:, None] + np.arange(width)).ravel()

    @cached_property
    def prismatic(self) -> IntArray:
        """Velocity indices of sliding coordinates: in m, all others in rad."""
        sliding = [part for name in self.joints for part in is_sliding(name, self.joint(name))]
        return np.flatnonzero(sliding)

    @cached_property
    def length(self) -> float:
        """Characteristic length in m: the widest distance between joints at the reference."""
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, self.reference)
        points = np.array([placement.translation for placement in list(data.oMi)[1:]])
        spread = np.linalg.norm(points[:, None] - points[None], axis=2)
        return float(spread.max()) or 1.0
