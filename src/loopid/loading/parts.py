"""Motors, bodies and locked joints of a robot file, looked up in the model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pinocchio as pin

from loopid.errors import RobotFileError
from loopid.loading.closures import link_frames
from loopid.loading.description import Description
from loopid.loading.reference import Reference, read_joint, written_reference
from loopid.loading.source import TreeSource
from loopid.robot import Body


def locked_values(
    file: Path, whole: pin.Model, reference: Mapping[str, Reference], locked: set[str]
) -> dict[str, float]:
    """Values at which joints with one coordinate are locked."""
    found = [name for name in locked if whole.existJointName(name)]
    joints = {name: whole.joints[whole.getJointId(name)] for name in found}
    single = {name: joint for name, joint in joints.items() if joint.nv == 1}
    # A list is for what has taken the place of the joint.
    at = {n: v for n, v in reference.items() if n in single and not isinstance(v, list)}
    q = written_reference(file, whole, at)
    return {name: read_joint(joint, q) for name, joint in single.items()}


def find_motors(
    file: Path, model: pin.Model, description: Description, locked: set[str]
) -> tuple[str, ...]:
    """Joints with motors that are not locked; all with one coordinate where no file says."""
    joints, motors = tuple(model.names)[1:], description.name_mot
    if motors is None:
        single = (name for name in joints if model.joints[model.getJointId(name)].nv == 1)
        return tuple(single)
    if isinstance(motors, str):
        motors = [name for name in joints if motors in name]
    for name in motors:
        if name not in (*joints, *locked):
            listed = ", ".join(joints)
            raise RobotFileError(
                f"{file}: unknown joint {name!r} in name_mot: choose among {listed}"
            )
    return tuple(name for name in motors if name not in locked)


def find_bodies(tree: TreeSource) -> tuple[Body, ...]:
    """Moving bodies with an inertial, each named by the link that its joint carries."""
    model, frames = tree.model, link_frames(tree.model)
    joint_ids = [model.frames[frames[link]].parentJoint for link in tree.inertial_links]
    moving = [joint for joint in dict.fromkeys(joint_ids) if joint > 0]
    if not moving:
        raise RobotFileError(f"{tree.file}: no moving link has an <inertial>: nothing to identify")
    return tuple(Body(tree.child_links[model.names[joint]], int(joint)) for joint in moving)
