"""A robot, with the values of a fit, as Pinocchio's own objects."""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan

import pinocchio as pin

from loopid.arguments import FloatArray, checked
from loopid.errors import ModelWarning, warn
from loopid.export.robot_file import joint_terms, straightened
from loopid.identification.force_models import ForceModel
from loopid.identification.quality import MotorUse
from loopid.loading.pinocchio_robot import MODEL_FIELDS
from loopid.robot.robot import Robot, shortened


@checked
def to_pinocchio(robot: Robot) -> tuple[pin.Model, pin.StdVec_RigidConstraintModel]:
    """Pinocchio's model of the open tree, and the constraints that close its loops.

    They are what ``constraintDynamics`` takes, and what is built on it. Rotor inertias, viscous and
    Coulomb friction of the robot file are in ``armature``, ``damping`` and ``friction``. With the
    values of a fit: ``fit.to_pinocchio()``.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    pin.Model, and Pinocchio's vector of ``RigidConstraintModel``

    Raises
    ------
    OptionError
        Naming a closure or a coupling that Pinocchio has no contact for.

    Warns
    -----
    ModelWarning
        Of joint terms that Pinocchio's model has no place for.

    Examples
    --------
    >>> import loopid
    >>> tree, loops = loopid.export.to_pinocchio(loopid.load("five_bar"))
    >>> tree.nv, [loop.type.name for loop in loops]
    (4, ['CONTACT_3D'])
    """
    return _with_terms(robot, robot.model.copy(), robot.joint_values), robot.constraint_models


def pinocchio_of(
    model: ForceModel, values: FloatArray, use: MotorUse | None
) -> tuple[pin.Model, pin.StdVec_RigidConstraintModel]:
    """Pinocchio's objects with the bodies and friction of a fit; see ``Fit.to_pinocchio``."""
    count = len(model.robot.parameters(model.model))
    terms, nearest = straightened(joint_terms(model.base.parameters, values), use)
    if nearest:
        warn(f"joint terms of Pinocchio's model: {'; '.join(nearest)}", ModelWarning)
    robot = model.robot
    return _with_terms(robot, robot.tree(values[:count]), terms), robot.constraint_models


def _with_terms(
    robot: Robot, tree: pin.Model, terms: Mapping[str, Mapping[str, float]]
) -> pin.Model:
    """The tree with joint terms in its fields."""
    others = []
    for joint, kinds in terms.items():
        for kind, value in kinds.items():
            if kind in MODEL_FIELDS and not isnan(value):
                field = getattr(tree, MODEL_FIELDS[kind])
                field[robot.velocity_indices([joint])] = value
            else:
                others.append(f"{joint}.{kind}")
    tree.lowerDryFrictionLimit = -tree.friction
    if others:
        warn(f"Pinocchio's model has no place for {shortened(others)}: left out", ModelWarning)
    return tree
