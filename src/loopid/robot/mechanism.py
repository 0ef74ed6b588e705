"""The robot: a tree, the closures of its loops, and the joints that have motors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray, IntArray, frozen
from loopid.parameters import KINDS, ParameterSet, model_kinds
from loopid.robot.body import Body
from loopid.robot.closure import JointCoupling, LoopClosure
from loopid.robot.identical import LinkGroup, tie_indices, tied_names
from loopid.robot.platform import Platform
from loopid.robot.tree import Tree


@dataclass(frozen=True)
class Mechanism(Tree):
    """A robot with or without closed loops.

    Attributes
    ----------
    name, path, model
        As in ``Tree``.
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
    options : mapping
        Arguments of ``load_mechanism`` beside the path, to load the same robot again.
    """

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
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "reference", frozen(self.reference))

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
    def held(self) -> tuple[str, ...]:
        """The other independent coordinates, parts of joints: rod spins, floating bases."""
        return tuple(name for name in self.independent if name not in self.joints)

    @property
    def passive(self) -> tuple[str, ...]:
        """Joints without motors."""
        return tuple(joint for joint in self.joints if joint not in self.actuated)

    @property
    def rows(self) -> int:
        """Number of scalar closure equations, redundant ones and couplings included."""
        return len(self.row_names)

    @property
    def row_names(self) -> tuple[str, ...]:
        """The closure or coupling that each scalar equation belongs to."""
        loops = (closure.name for closure in self.closures for _ in range(closure.rows))
        return (*loops, *(coupling.name for coupling in self.couplings))

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
    def length(self) -> float:
        """Characteristic length in m: the widest distance between joints at the reference."""
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, self.reference)
        points = np.array([placement.translation for placement in list(data.oMi)[1:]])
        spread = np.linalg.norm(points[:, None] - points[None], axis=2)
        return float(spread.max()) or 1.0
