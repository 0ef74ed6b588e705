"""The open tree of a robot: read from a file, joints replaced and locked; values of joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.errors import LoopidError, OptionError, RobotFileError
from loopid.loading.description import Description

HINGES = {"X": pin.JointModelRX, "Y": pin.JointModelRY, "Z": pin.JointModelRZ}
LARGEST = 1e100  # as for the numbers of a URDF
# Index of the first number of a quaternion, or of cosine and sine.
UNIT_PARTS = {"JointModelSpherical": 0, "JointModelFreeFlyer": 3, "JointModelPlanar": 2}
# Of a joint with one coordinate its value, of another one its part of the configuration.
Reference = float | list[float]
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
    whole = list(description.fixed)
    left: dict[str, str] = {}  # axes about which a spherical joint with locked turns still turns
    for name in locked:
        joint, _, turn = name.rpartition(".")
        model = source.model
        if model.existJointName(name) or not model.existJointName(joint):
            whole.append(name)
            continue
        spherical = model.joints[model.getJointId(joint)].shortname() == "JointModelSpherical"
        if turn not in TURNS or not spherical:
            raise OptionError(
                f"{name} cannot be locked alone: lock {joint}, or a turn of a ball joint"
            )
        left[joint] = left.get(joint, "XYZ").replace(TURNS[turn], "")
    for joint, axes in left.items():
        if not axes:
            raise OptionError(f"all turns of {joint} are locked: lock the joint instead")
    source = _replaced(source, {joint: _hinges(axes) for joint, axes in left.items()})
    model = source.model
    for name in whole:
        joint_named(name, model, f"{file}: unknown joint {name!r} to lock", OptionError)
    if whole:
        values = {name: at for name, at in description.reference.items() if name in whole}
        q, ids = written_reference(file, model, values), [model.getJointId(name) for name in whole]
        try:
            model = pin.buildReducedModel(model, ids, q)
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise RobotFileError(f"{file}: Pinocchio cannot lock joints of it: {reason}") from error
    if model.nv == 0:
        raise RobotFileError(
            f"{source.file}: no joint can move, unless its base floats (floating_base: true)"
        )
    return replace(source, model=model)


def _hinges(axes: str) -> Chain:
    return tuple((f"_{axis}", HINGES[axis]()) for axis in axes)


def _replacements(model: pin.Model, description: Description) -> dict[str, Chain]:
    """What the description puts in the place of joints, and hinges without limits for couplings.

    A gear ratio relates turns that add up; a ``continuous`` joint only counts its angle on the
    circle.
    """
    chains: dict[str, Chain] = {}
    for name, kind in zip(description.joint_name, description.joint_type, strict=True):
        if kind == "SPHERICAL":
            chains[name] = (("", pin.JointModelSpherical()),)
        elif kind != "FIXED":
            chains[name] = _hinges(kind.removeprefix("UJOINT_"))
    for name in (name for closure in description.closures for name in closure.joints or ()):
        if name not in chains and model.existJointName(name):
            joint = model.joints[model.getJointId(name)]
            if joint.nv == 1 and joint.nq == 2:
                data = joint.createData()
                joint.calc(data, np.array([1.0, 0.0]))
                axis = np.asarray(data.S, dtype=np.float64).reshape(6)[3:]
                chains[name] = (("", pin.JointModelRevoluteUnaligned(axis)),)
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


# Values of joints.


def joint_named(
    name: str, model: pin.Model, problem: str, failure: type[LoopidError] = RobotFileError
) -> pin.JointModel:
    """Joint of a name; where there is none, an error that lists the joints."""
    names = list(model.names)[1:]
    if name not in names:
        raise failure(f"{problem}: choose among {', '.join(names)}")
    return model.joints[model.getJointId(name)]


def written_reference(file: Path, model: pin.Model, values: Mapping[str, Reference]) -> FloatArray:
    """Configuration (nq,) with the given joint values; others in the middle of their limits."""
    q = pin.neutral(model)
    for joint in list(model.joints)[1:]:
        if joint.nq == 1:
            k = joint.idx_q
            low, high = model.lowerPositionLimit[k], model.upperPositionLimit[k]
            if not low <= q[k] <= high:
                q[k] = 0.5 * (low + high)
    for name, value in values.items():
        joint = joint_named(name, model, f"{file}: unknown joint {name!r} in reference")
        what, given = f"{file}: joint {name} in reference", np.array(value, float, ndmin=1)
        if not (np.abs(given) < LARGEST).all():
            raise RobotFileError(f"{what} must be finite and below {LARGEST:g}, not {value}")
        wanted = 1 if joint.nv == 1 else joint.nq
        if len(given) != wanted:
            count = "one number" if wanted == 1 else f"a list of {wanted} numbers"
            raise RobotFileError(f"{what} must be {count}, not {value}")
        if joint.nv == 1:
            write_joint(joint, q, float(given[0]))
            continue
        turn = given[UNIT_PARTS.get(joint.shortname(), len(given)) :]
        if len(turn):
            size = float(np.linalg.norm(turn))
            if not 0.9 < size < 1.1:
                raise RobotFileError(
                    f"{what} must end in a unit vector, not one of length {size:.3g}"
                )
            turn /= size
        q[joint.idx_q : joint.idx_q + joint.nq] = given
    return np.asarray(q, dtype=np.float64)


def read_joint(joint: pin.JointModel, q: FloatArray) -> float:
    """Value of a joint with one coordinate in a configuration."""
    first = joint.idx_q
    return float(np.arctan2(q[first + 1], q[first]) if joint.nq == 2 else q[first])


def write_joint(joint: pin.JointModel, q: FloatArray, value: float) -> None:
    """Put the value of a joint with one coordinate into a configuration, in place."""
    coordinates = [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
    q[joint.idx_q : joint.idx_q + joint.nq] = coordinates
