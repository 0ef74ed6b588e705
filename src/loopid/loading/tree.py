"""The open tree of a robot: read from a file, joints replaced and locked; values of joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arguments import LARGEST, FloatArray, checked_outside, finite, number, shaped
from loopid.errors import OptionError, RobotFileError
from loopid.loading.description import Description
from loopid.loading.model_closures import ROUNDED, frame_named, joint_named
from loopid.robot.robot import LeftOut, motion_subspace, position_of

HINGES = {"X": pin.JointModelRX, "Y": pin.JointModelRY, "Z": pin.JointModelRZ}
# Index of the first number of a quaternion, or of cosine and sine.
UNIT_PARTS = {"JointModelSpherical": 0, "JointModelFreeFlyer": 3, "JointModelPlanar": 2}
# Of a joint with one coordinate its value, of another one its part of the configuration.
Reference = float | list[float]
TURNS = {"wx": "X", "wy": "Y", "wz": "Z"}
# What takes the place of a joint: joints one after the other, each with the ending of its name.
Chain = tuple[tuple[str, pin.JointModel], ...]


@checked_outside
@dataclass(frozen=True)
class TreeSource:
    """An open tree as read from a file.

    Examples
    --------
    >>> from pathlib import Path
    >>> import pinocchio as pin
    >>> from loopid.loading import TreeSource
    >>> TreeSource("arm", Path("arm.urdf"), pin.Model(), (), {}).name
    'arm'
    """

    name: str  # of the robot
    file: Path | str  # where the tree was read, or the robot's name; named in messages
    # With a frame of type ``BODY`` for every link, named like it, and ``OP_FRAME`` frames for
    # whatever the description's closures join beyond links
    model: pin.Model
    inertial_links: tuple[str, ...]  # links with inertia, in the order of the file
    child_links: dict[str, str]  # joint name to the link that it carries
    # What the file itself says of closures, motors and reference
    description: Description = field(default_factory=Description)
    notes: tuple[str, ...] = ()  # what the file says and the model leaves out: warned of on loading
    # Joint of the file to the joints that have taken its place
    replaced: dict[str, tuple[str, ...]] = field(default_factory=dict)
    # Forces of the file that no model has: warned of on loading, too
    left_out: tuple[LeftOut, ...] = ()
    signs: tuple[str, ...] = ()  # of loops that the file does not declare: warned of on loading
    # Joints, and turns of joints, that are locked; those with one coordinate with its value
    locked: dict[str, float | None] = field(default_factory=dict)


def add_frame(model: pin.Model, name: str, link: str, placement: pin.SE3) -> None:
    """Mount a frame in a link of a model, at a placement in m, for a closure to join."""
    index = model.getFrameId(link, pin.FrameType.BODY)
    carrier = model.frames[index]
    there = carrier.placement * placement
    frame = pin.Frame(name, carrier.parentJoint, index, there, pin.FrameType.OP_FRAME)
    model.addFrame(frame, False)


def build_tree(source: TreeSource, description: Description, locked: Sequence[str]) -> TreeSource:
    """Replace and lock the joints that the description or the caller names.

    Locked are joints, or single turns of spherical joints such as ``ball.wz``. Joints with one
    coordinate may have the value, as in ``hip=0.5``. The reference of the description comes back
    with the values of the joints that are left.
    """
    locked, held_at = _named_values(source.model, locked)
    held = {**description.reference, **held_at}
    description = description.model_copy(update={"reference": held})
    for name in description.joint_name:
        joint_named(source.model, name, "in joint_name")
    source = replace(source, description=description)
    _add_lengths(source.model, description)
    for name in description.drives:  # a turning joint for each motor that turns several joints
        _add_joint(source.model, "drives", name, pin.JointModelRZ(), pin.SE3.Identity())
    if description.gravity is not None:
        source.model.gravity.linear = np.array(description.gravity)
    source = _replaced(source, _replacements(source.model, description), turned=False)
    for name, limits in description.limits.items():
        joint = joint_named(source.model, name, "in limits")
        if joint.nq != 1:
            raise RobotFileError(f"limits: joint {name} has {joint.nv} coordinates")
        low, high = limits or (-np.inf, np.inf)
        source.model.lowerPositionLimit[joint.idx_q] = low
        source.model.upperPositionLimit[joint.idx_q] = high
    chains = _locks(source, (*description.fixed, *locked))
    at = _locked_values(source, dict.fromkeys((*description.fixed, *locked)))
    source = replace(_replaced(source, chains, turned=True), locked=at)
    if source.model.nv == 0:
        raise RobotFileError("no joint can move")
    return source


def _add_lengths(model: pin.Model, description: Description) -> None:
    """Add a sliding joint for each length of a cable, where the cable begins."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    starts = {c.joint: c.frames[0] for c in description.all_closures if c.joint and c.frames}
    for name in description.lengths:
        place = pin.SE3.Identity()
        if name in starts:
            place.translation = data.oMf[frame_named(model, starts[name])].translation
        _add_joint(model, "cables", name, pin.JointModelPZ(), place)


def _add_joint(
    model: pin.Model, key: str, name: str, joint: pin.JointModel, place: pin.SE3
) -> None:
    """Add a joint without mass and limits, that a key of the description names."""
    if model.existJointName(name):
        raise RobotFileError(f"{key}: {name} is the name of a joint")
    unlimited = np.full(1, np.inf)
    limits = unlimited, unlimited, -unlimited, unlimited
    model.addJointFrame(model.addJoint(0, joint, place, name, *limits), 0)


def _locks(source: TreeSource, names: Iterable[str]) -> dict[str, Chain]:
    """What is left of joints that are locked: nothing, or hinges of a ball with locked turns."""
    whole: list[str] = []
    left: dict[str, str] = {}  # axes about which a spherical joint with locked turns still turns
    model = source.model
    joints = list(model.names)[1:]  # of texts that Pinocchio could not take, too
    lengths = {closure.joint for closure in source.description.all_closures}
    for name in names:
        if name in source.description.drives:
            turned = ", ".join(source.description.drives[name])
            raise OptionError(f"{name} cannot be locked: lock what it turns, {turned}", given=name)
        if name in (*lengths, *source.description.lengths):
            raise OptionError(
                f"{name} cannot be locked, as a cable has that length: a rod of one length is a "
                "closure of type distance",
                given=name,
            )
        joint, _, turn = name.rpartition(".")
        if name in joints or joint not in joints:
            # What has taken the place of a joint is locked with it.
            whole += source.replaced.get(name, (name,))
            continue
        spherical = model.joints[model.getJointId(joint)].shortname() == "JointModelSpherical"
        if turn not in TURNS or not spherical:
            raise OptionError(
                f"{name} cannot be locked alone: lock {joint}, or a turn of a ball joint",
                given=name,
            )
        left[joint] = left.get(joint, "XYZ").replace(TURNS[turn], "")
    for name in whole:
        OptionError.require("joint to lock", name, joints)
    return {joint: _hinges(axes) for joint, axes in left.items()} | dict.fromkeys(whole, ())


def _named_values(
    model: pin.Model, given: Sequence[str]
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Joints to lock, and the values of those that have one behind their name."""
    values: dict[str, float] = {}
    names = []
    for text in given:
        name, sign, value = text.rpartition("=")
        if not sign or model.existJointName(text):
            names.append(text)
            continue
        names.append(name)
        if not model.existJointName(name):
            continue  # refused as any unknown joint
        values[name] = number(value)
        if model.joints[model.getJointId(name)].nv != 1 or not np.isfinite(values[name]):
            raise OptionError(
                f"lock {text!r} must be JOINT=VALUE, a joint with one coordinate and a number in "
                "rad or m",
                given=text,
            )
    return tuple(names), values


def _locked_values(source: TreeSource, names: Mapping[str, None]) -> dict[str, float | None]:
    """What is locked; joints with one coordinate with the value that they are locked at."""
    model = source.model
    joints = {
        name: model.joints[model.getJointId(name)]
        for name in names
        if name in list(model.names)[1:] and model.joints[model.getJointId(name)].nv == 1
    }
    reference = source.description.reference
    # A list is for what has taken the place of the joint.
    at = {k: v for k, v in reference.items() if k in joints and not isinstance(v, list)}
    q = written_reference(model, at)
    return {**names, **{name: float(position_of(joint, q)) for name, joint in joints.items()}}


def _hinges(axes: str) -> Chain:
    return tuple((f"_{axis}", HINGES[axis]()) for axis in axes)


def _replacements(model: pin.Model, description: Description) -> dict[str, Chain]:
    """What takes the places of joints; hinges where couplings or limits need turns that add up."""
    chains: dict[str, Chain] = {}
    for name, kind in zip(description.joint_name, description.joint_type, strict=True):
        if kind == "SPHERICAL":
            chains[name] = (("", pin.JointModelSpherical()),)
        elif kind != "FIXED":
            chains[name] = _hinges(kind.removeprefix("UJOINT_"))
    coupled = [
        name for c in description.all_closures for name in (*(c.joints or ()), *(c.of or ()))
    ]
    for name in (*coupled, *description.limits):
        if name not in chains and model.existJointName(name):
            joint = model.joints[model.getJointId(name)]
            if joint.nv == 1 and joint.nq == 2:
                axis = motion_subspace(model, model.getJointId(name))[3:, 0]
                chains[name] = (("", pin.JointModelRevoluteUnaligned(axis)),)
    return chains


def _replaced(source: TreeSource, chains: Mapping[str, Chain], turned: bool) -> TreeSource:
    """The tree with other joints in the places of some; bodies hang on the last of each chain.

    Where a joint is ``turned``, its reference becomes the zero of what takes its place. Else the
    reference of the chain comes as near to the joint's as it can.
    """
    if not chains:
        return source
    old, model = source.model, pin.Model()
    model.name, model.gravity = old.name, old.gravity
    # From joints of the old model to those of the new one and placements in them; frames too.
    mounts, frames = {0: (0, pin.SE3.Identity())}, {0: 0}
    reference, taken = dict(source.description.reference), dict[str, tuple[str, ...]]()
    for index in range(1, old.njoints):
        parent, mount = mounts[old.parents[index]]
        placement = mount * old.jointPlacements[index]
        name, joint = old.names[index], old.joints[index]
        if name in chains:
            taken[name] = tuple(name + ending for ending, _ in chains[name])
            start = _start(old, name, reference, chains[name])
            if start is not None and turned:
                placement = placement * start
            elif start is not None:
                values = _nearest(start.rotation, [hinge for _, hinge in chains[name]])
                reference |= dict(zip(taken[name], values, strict=True))
            for part, (_, hinge) in zip(taken[name], chains[name], strict=True):
                parent = model.addJoint(parent, hinge, placement, part)
                placement = pin.SE3.Identity()
        else:
            q = slice(joint.idx_q, joint.idx_q + joint.nq)
            v = slice(joint.idx_v, joint.idx_v + joint.nv)
            most = old.upperEffortLimit[v], old.upperVelocityLimit[v]
            limits = old.lowerPositionLimit[q], old.upperPositionLimit[q]
            parent = model.addJoint(parent, joint, placement, name, *most, *limits)
            placement = pin.SE3.Identity()
        mounts[index] = int(parent), placement
        model.appendBodyToJoint(parent, old.inertias[index], placement)
    for index, frame in list(enumerate(old.frames))[1:]:
        joint, mount = mounts[frame.parentJoint]
        place = mount * frame.placement
        copy = pin.Frame(frame.name, joint, frames[frame.parentFrame], place, frame.type)
        frames[index] = model.addFrame(copy, False)
    carried = {
        model.names[mounts[old.getJointId(name)][0]] if old.existJointName(name) else name: link
        for name, link in source.child_links.items()
        if chains.get(name) != ()
    }
    before = {
        name: tuple(end for part in parts for end in taken.get(part, (part,)))
        for name, parts in source.replaced.items()
    }
    return replace(
        source,
        model=model,
        child_links=carried,
        description=source.description.model_copy(update={"reference": reference}),
        replaced=taken | before,
    )


def _start(
    model: pin.Model, name: str, reference: dict[str, Reference], chain: Chain
) -> pin.SE3 | None:
    """Take a joint's motion from the reference; None where that is of what takes its place."""
    parts = [name + ending for ending, _ in chain]
    joint, given = model.joints[model.getJointId(name)], reference.get(name)
    if parts == [name] and isinstance(given, list) == (chain[0][1].nv > 1):
        return None
    if chain and (given is None or any(part in reference for part in parts if part != name)):
        reference.pop(name, None)
        return None
    q = written_reference(model, {name: reference.pop(name)} if given is not None else {})
    data = joint.createData()
    joint.calc(data, q)
    return data.M


def _nearest(rotation: FloatArray, chain: Sequence[pin.JointModel]) -> list[Reference]:
    """Values of a ball, or of hinges about axes of the frame, that come near to a rotation."""
    axes = {kind().shortname(): np.eye(3)[k] for k, kind in enumerate(HINGES.values())}
    if len(chain) == 1:
        return [pin.Quaternion(rotation).coeffs().tolist()]
    first, second = (axes[hinge.shortname()] for hinge in chain)
    return [_angle(first, second, rotation @ second), -_angle(second, first, rotation.T @ first)]


def _angle(axis: FloatArray, start: FloatArray, end: FloatArray) -> float:
    return float(np.arctan2(axis @ np.cross(start, end), start @ end))


# Values of joints.


def written_reference(model: pin.Model, values: Mapping[str, Reference]) -> FloatArray:
    """Configuration (nq,) with the given joint values; others in the middle of their limits."""
    q = pin.neutral(model)
    for joint in list(model.joints)[1:]:
        if joint.nq == 1:
            k = joint.idx_q
            low, high = model.lowerPositionLimit[k], model.upperPositionLimit[k]
            if not low <= q[k] <= high:
                q[k] = 0.5 * (low + high)
    for name, value in values.items():
        joint = joint_named(model, name, "in reference")
        given = _joint_value(joint, name, value)
        if joint.nv == 1:
            write_joint(joint, q, float(given[0]))
        else:
            q[joint.idx_q : joint.idx_q + joint.nq] = given
    return np.asarray(q, dtype=np.float64)


def _joint_value(joint: pin.JointModel, name: str, value: Reference) -> FloatArray:
    """The numbers of a joint in a reference, as many as it needs; quaternions are normalised."""
    what, given = f"joint {name} in reference", np.array(value, float, ndmin=1)
    keys = ("reference", name)
    if not (np.abs(given) < LARGEST).all():
        raise RobotFileError(f"{what} must be finite and below {LARGEST:g}, not {value}", keys=keys)
    wanted = 1 if joint.nv == 1 else joint.nq
    if len(given) != wanted:
        count = "one number" if wanted == 1 else f"a list of {wanted} numbers"
        raise RobotFileError(f"{what} must be {count}, not {value}", keys=keys)
    turn = given[UNIT_PARTS.get(joint.shortname(), len(given)) :] if joint.nv > 1 else given[:0]
    if len(turn):
        size = float(np.linalg.norm(turn))
        if not abs(size - 1) < ROUNDED:
            raise RobotFileError(f"{what} must end in a unit vector, not one of length {size:.3g}")
        turn /= size
    return given


def write_joint(joint: pin.JointModel, q: FloatArray, value: float) -> None:
    """Put the value of a joint with one coordinate into a configuration, in place."""
    coordinates = [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
    q[joint.idx_q : joint.idx_q + joint.nq] = coordinates


def joint_values(
    tree: pin.Model, reference: Mapping[str, Reference] | FloatArray | None
) -> Mapping[str, Reference]:
    """Values of joints of a reference, which may be a configuration (nq,)."""
    if reference is None:
        return {}
    if isinstance(reference, Mapping):
        return {
            name: finite(value, f"reference of {name}").tolist()
            for name, value in reference.items()
        }
    q = shaped(reference, "reference", tree.nq)
    return {
        tree.names[k]: float(position_of(own, q))
        if own.nv == 1
        else q[own.idx_q : own.idx_q + own.nq].tolist()
        for k, own in enumerate(tree.joints)
        if k > 0
    }
