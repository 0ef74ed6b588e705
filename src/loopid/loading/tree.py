"""The open tree as the robot's files want it: joints replaced, joints locked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pinocchio as pin

from loopid.errors import OptionError, RobotFileError
from loopid.loading.description import Description
from loopid.loading.reference import Reference, written_reference
from loopid.loading.replacing import Chain, chain_of, replace_joints, unwound
from loopid.loading.source import TreeSource

ANGULAR = {"wx": "X", "wy": "Y", "wz": "Z"}


def build_tree(
    file: Path, source: TreeSource, description: Description, locked: Sequence[str]
) -> TreeSource:
    """Replace and lock the joints that the description, or the caller, asks for.

    Parameters
    ----------
    locked : sequence of str
        Joints, or single turns of spherical joints such as ``ball.wz``.

    Raises
    ------
    RobotFileError, OptionError
        Where a joint is unknown, or cannot be replaced or locked.
    """
    joints = list(source.model.names)[1:]
    for name in description.joint_name:
        if name not in joints:
            raise RobotFileError(
                f"{file}: unknown joint {name!r} in joint_name: choose among {', '.join(joints)}"
            )
    source = replace_joints(source, _replacements(source.model, description))
    turns = {name: _turn(source.model, name) for name in locked}
    source = replace_joints(source, _without_turns(source.model, turns))
    whole = [*description.fixed, *(n for n in locked if turns[n] is None)]
    model = _locked(file, source.model, whole, description.reference)
    if model.nv == 0:
        raise RobotFileError(
            f"{source.file}: no joint can move, unless its base floats (floating_base: true)"
        )
    return replace(source, model=model)


def _replacements(model: pin.Model, description: Description) -> dict[str, Chain]:
    pairs = zip(description.joint_name, description.joint_type, strict=True)
    chains = {name: chain_of(kind) for name, kind in pairs if kind != "FIXED"}
    coupled = [name for c in description.closures for name in c.joints or ()]
    for name in coupled:
        if name not in chains and model.existJointName(name):
            joint = model.joints[model.getJointId(name)]
            if joint.nv == 1 and joint.nq == 2:
                chains[name] = unwound(joint)
    return chains


def _turn(model: pin.Model, name: str) -> tuple[str, str] | None:
    """Joint and turn of a name such as ``ball.wz``; nothing for a joint's own name."""
    joint, _, part = name.rpartition(".")
    if model.existJointName(name) or not model.existJointName(joint):
        return None
    kind = model.joints[model.getJointId(joint)].shortname()
    if part not in ANGULAR or kind != "JointModelSpherical":
        raise OptionError(f"{name} cannot be locked alone: lock {joint}, or a turn of a ball joint")
    return joint, part


def _without_turns(
    model: pin.Model, turns: Mapping[str, tuple[str, str] | None]
) -> dict[str, Chain]:
    """Joints with the turns that are left of spherical ones."""
    lost: dict[str, str] = {}
    for turn in turns.values():
        if turn is not None:
            lost[turn[0]] = lost.get(turn[0], "") + ANGULAR[turn[1]]
    left = {joint: [axis for axis in "XYZ" if axis not in axes] for joint, axes in lost.items()}
    for joint, axes in left.items():
        if not axes:
            raise OptionError(f"all turns of {joint} are locked: lock the joint instead")
    return {joint: chain_of("UJOINT_" + "".join(axes)) for joint, axes in left.items()}


def _locked(
    file: Path, model: pin.Model, names: Sequence[str], reference: Mapping[str, Reference]
) -> pin.Model:
    joints = list(model.names)[1:]
    for name in names:
        if name not in joints:
            listed = ", ".join(joints)
            raise OptionError(f"{file}: unknown joint {name!r} to lock: choose among {listed}")
    if not names:
        return model
    at_lock = {name: value for name, value in reference.items() if name in names}
    at = written_reference(file, model, at_lock)
    try:
        return pin.buildReducedModel(model, [model.getJointId(name) for name in names], at)
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"{file}: Pinocchio cannot lock joints of it: {reason}") from error
