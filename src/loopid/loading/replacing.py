"""Joints put in the place of those a tree format has no name for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from loopid.loading.source import TreeSource

HINGES = {"X": pin.JointModelRX, "Y": pin.JointModelRY, "Z": pin.JointModelRZ}
# What takes the place of a joint: joints one after the other, each with the ending of its name.
Chain = tuple[tuple[str, pin.JointModel], ...]


def chain_of(joint_type: str) -> Chain:
    """Joints that a type of the robot file stands for, such as ``UJOINT_ZY``."""
    if joint_type == "SPHERICAL":
        return (("", pin.JointModelSpherical()),)
    axes = joint_type.removeprefix("UJOINT_")
    return tuple((f"_{axis}", HINGES[axis]()) for axis in axes)


def unwound(joint: pin.JointModel) -> Chain:
    """A hinge without limits in the place of one that counts its angle on the circle only.

    A gear ratio relates turns that add up, not directions.
    """
    data = joint.createData()
    joint.calc(data, np.array([1.0, 0.0]))
    axis = np.asarray(data.S, dtype=np.float64).reshape(6)[3:]
    return (("", pin.JointModelRevoluteUnaligned(axis)),)


def replace_joints(source: TreeSource, chains: Mapping[str, Chain]) -> TreeSource:
    """The tree with other joints in the places of some; bodies hang on the last of each chain."""
    if not chains:
        return source
    old, model = source.model, pin.Model()
    model.name, model.gravity = old.name, old.gravity
    last = {0: 0}
    for index in range(1, old.njoints):
        last[index] = _add_joint(model, old, index, last[old.parents[index]], chains)
        model.appendBodyToJoint(last[index], old.inertias[index], pin.SE3.Identity())
    _copy_frames(model, old, last)
    carried = {
        model.names[last[old.getJointId(name)]] if old.existJointName(name) else name: link
        for name, link in source.child_links.items()
    }
    return replace(source, model=model, child_links=carried)


def _add_joint(
    model: pin.Model, old: pin.Model, index: int, parent: int, chains: Mapping[str, Chain]
) -> int:
    name, placement = old.names[index], old.jointPlacements[index]
    if name not in chains:
        return _add_same(model, old, index, parent)
    for ending, joint in chains[name]:
        parent = model.addJoint(parent, joint, placement, name + ending)
        placement = pin.SE3.Identity()
    return int(parent)


def _add_same(model: pin.Model, old: pin.Model, index: int, parent: int) -> int:
    joint = old.joints[index]
    q = slice(joint.idx_q, joint.idx_q + joint.nq)
    v = slice(joint.idx_v, joint.idx_v + joint.nv)
    limits = (
        old.upperEffortLimit[v],
        old.upperVelocityLimit[v],
        old.lowerPositionLimit[q],
        old.upperPositionLimit[q],
    )
    return int(model.addJoint(parent, joint, old.jointPlacements[index], old.names[index], *limits))


def _copy_frames(model: pin.Model, old: pin.Model, last: Mapping[int, int]) -> None:
    places = {0: 0}
    for index, frame in list(enumerate(old.frames))[1:]:
        joint, parent = last[frame.parentJoint], places[frame.parentFrame]
        copy = pin.Frame(frame.name, joint, parent, frame.placement, frame.type)
        places[index] = model.addFrame(copy, False)
