"""The open tree: Pinocchio's model of a URDF, with joints locked on request."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.errors import OptionError, RobotFileError
from loopid.loading.reference import written_reference
from loopid.loading.urdf import UrdfContent


def build_tree(
    file: Path,
    urdf: Path,
    content: UrdfContent,
    locked: Sequence[str],
    reference: dict[str, float],
) -> pin.Model:
    """Build the model of a URDF; locked joints stay at their reference.

    Raises
    ------
    RobotFileError, OptionError
        Where Pinocchio refuses the file, or a joint cannot be locked or mimics another.
    """
    try:
        model = pin.buildModelFromUrdf(str(urdf))
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"{urdf}: Pinocchio refuses it: {reason}") from error
    joints = list(model.names)[1:]
    for name in locked:
        if name not in joints:
            listed = ", ".join(joints)
            raise OptionError(f"{file}: unknown joint {name!r} to lock: choose among {listed}")
    for follower, leader in content.mimics.items():
        if follower in joints and follower not in locked:
            raise RobotFileError(
                f"{urdf}: joint {follower} mimics {leader}, which is not supported: lock it"
            )
    at_lock = {name: reference[name] for name in locked if name in reference}
    at = written_reference(file, model, at_lock)
    if locked:
        model = _lock(urdf, model, locked, at)
    if model.nv == 0:
        raise RobotFileError(f"{urdf}: no joint can move")
    return model


def _lock(urdf: Path, model: pin.Model, locked: Sequence[str], at: FloatArray) -> pin.Model:
    try:
        return pin.buildReducedModel(model, [model.getJointId(name) for name in locked], at)
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"{urdf}: Pinocchio cannot lock joints of it: {reason}") from error
