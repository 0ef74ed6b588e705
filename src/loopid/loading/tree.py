"""The open tree: what every reader of a file hands over, then joints replaced and joints locked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.errors import OptionError, RobotFileError
from loopid.loading.description import Description
from loopid.loading.reference import Reference, joint_named, written_reference

HINGES = {"X": pin.JointModelRX, "Y": pin.JointModelRY, "Z": pin.JointModelRZ}
TURNS = {"wx": "X", "wy": "Y", "wz": "Z"}
# What takes the place of a joint: joints one after the other, each with the ending of its name.
Chain = tuple[tuple[str, pin.JointModel], ...]


@dataclass(frozen=True)
class TreeSource:
    """An open tree as read from a file.

    Attributes
    ----------
    name : str
        Of the robot.
    file : Path
        Where the tree was read; named in messages.
    model : pinocchio.Model
        With a frame of type ``BODY`` for every link, named like it, and ``OP_FRAME`` frames for
        whatever the description's closures join beyond links.
    inertial_links : tuple of str
        Links with inertia, in the order of the file.
    child_links : dict
        Joint name to the link that it carries.
    description : Description
        What the file itself says of closures, motors and reference.
    notes : tuple of str
        What the file says and the model leaves out, such as springs: warned of on loading.
    """

    name: str
    file: Path
    model: pin.Model
    inertial_links: tuple[str, ...]
    child_links: dict[str, str]
    description: Description = field(default_factory=Description)
    notes: tuple[str, ...] = ()


def add_frame(model: pin.Model, name: str, link: str, placement: pin.SE3) -> None:
    """Mount a frame at a placement in a link, for a closure to join."""
    index = model.getFrameId(link, pin.FrameType.BODY)
    carrier = model.frames[index]
    there = carrier.placement * placement
    frame = pin.Frame(name, carrier.parentJoint, index, there, pin.FrameType.OP_FRAME)
    model.addFrame(frame, False)


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
    for name in description.joint_name:
        joint_named(name, source.model, f"{file}: unknown joint {name!r} in joint_name")
    source = _replaced(source, _replacements(source.model, description))
    turns = {name: turn for name in locked if (turn := _turn(source.model, name)) is not None}
    source = _replaced(source, _without_turns([*turns.values()]))
    whole = [*description.fixed, *(name for name in locked if name not in turns)]
    model = _locked(file, source.model, whole, description.reference)
    if model.nv == 0:
        raise RobotFileError(
            f"{source.file}: no joint can move, unless its base floats (floating_base: true)"
        )
    return replace(source, model=model)


def _replacements(model: pin.Model, description: Description) -> dict[str, Chain]:
    """What the description puts in the place of joints, and hinges without limits for couplings.

    A gear ratio relates turns that add up; a ``continuous`` joint only counts its angle on the
    circle.
    """
    pairs = zip(description.joint_name, description.joint_type, strict=True)
    chains = {name: _chain(kind) for name, kind in pairs if kind != "FIXED"}
    for name in (name for closure in description.closures for name in closure.joints or ()):
        if name not in chains and model.existJointName(name):
            joint = model.joints[model.getJointId(name)]
            if joint.nv == 1 and joint.nq == 2:
                data = joint.createData()
                joint.calc(data, np.array([1.0, 0.0]))
                axis = np.asarray(data.S, dtype=np.float64).reshape(6)[3:]
                chains[name] = (("", pin.JointModelRevoluteUnaligned(axis)),)
    return chains


def _chain(joint_type: str) -> Chain:
    """Joints that a type of the robot file stands for, such as ``UJOINT_ZY``."""
    if joint_type == "SPHERICAL":
        return (("", pin.JointModelSpherical()),)
    return tuple((f"_{axis}", HINGES[axis]()) for axis in joint_type.removeprefix("UJOINT_"))


def _turn(model: pin.Model, name: str) -> tuple[str, str] | None:
    """Joint and axis of a name such as ``ball.wz``; none for a joint's own name."""
    joint, _, part = name.rpartition(".")
    if model.existJointName(name) or not model.existJointName(joint):
        return None
    kind = model.joints[model.getJointId(joint)].shortname()
    if part not in TURNS or kind != "JointModelSpherical":
        raise OptionError(f"{name} cannot be locked alone: lock {joint}, or a turn of a ball joint")
    return joint, TURNS[part]


def _without_turns(turns: Sequence[tuple[str, str]]) -> dict[str, Chain]:
    """Hinges about the axes that are left of spherical joints."""
    chains = {}
    for joint in dict.fromkeys(joint for joint, _ in turns):
        left = [axis for axis in "XYZ" if (joint, axis) not in turns]
        if not left:
            raise OptionError(f"all turns of {joint} are locked: lock the joint instead")
        chains[joint] = _chain("UJOINT_" + "".join(left))
    return chains


def _replaced(source: TreeSource, chains: Mapping[str, Chain]) -> TreeSource:
    """The tree with other joints in the places of some; bodies hang on the last of each chain."""
    if not chains:
        return source
    old, model = source.model, pin.Model()
    model.name, model.gravity = old.name, old.gravity
    last, frames = {0: 0}, {0: 0}  # from indices of the old model to those of the new one
    for index in range(1, old.njoints):
        parent, placement = last[old.parents[index]], old.jointPlacements[index]
        name, joint = old.names[index], old.joints[index]
        if name in chains:
            for ending, hinge in chains[name]:
                parent = model.addJoint(parent, hinge, placement, name + ending)
                placement = pin.SE3.Identity()
        else:
            q = slice(joint.idx_q, joint.idx_q + joint.nq)
            v = slice(joint.idx_v, joint.idx_v + joint.nv)
            most = old.upperEffortLimit[v], old.upperVelocityLimit[v]
            limits = old.lowerPositionLimit[q], old.upperPositionLimit[q]
            parent = model.addJoint(parent, joint, placement, name, *most, *limits)
        last[index] = parent
        model.appendBodyToJoint(parent, old.inertias[index], pin.SE3.Identity())
    for index, frame in list(enumerate(old.frames))[1:]:
        ends = last[frame.parentJoint], frames[frame.parentFrame]
        copy = pin.Frame(frame.name, *ends, frame.placement, frame.type)
        frames[index] = model.addFrame(copy, False)
    carried = {
        model.names[last[old.getJointId(name)]] if old.existJointName(name) else name: link
        for name, link in source.child_links.items()
    }
    return replace(source, model=model, child_links=carried)


def _locked(
    file: Path, model: pin.Model, names: Sequence[str], reference: Mapping[str, Reference]
) -> pin.Model:
    for name in names:
        joint_named(name, model, f"{file}: unknown joint {name!r} to lock", OptionError)
    if not names:
        return model
    at = written_reference(file, model, {n: v for n, v in reference.items() if n in names})
    try:
        return pin.buildReducedModel(model, [model.getJointId(name) for name in names], at)
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise RobotFileError(f"{file}: Pinocchio cannot lock joints of it: {reason}") from error
