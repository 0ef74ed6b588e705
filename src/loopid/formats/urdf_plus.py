"""URDF+ [Chignoli2024]: ``<coupling>``, and joints that are ``independent``."""

from __future__ import annotations

import pinocchio as pin

from loopid.border import validated
from loopid.errors import RobotFileError, naming
from loopid.loading.description import ClosureDescription
from loopid.loading.urdf import Dialect, linked
from loopid.loading.urdf_tree import UrdfFile
from loopid.loading.xml_elements import child, inner_tags, label, named_tags, numbers, required

ENDS = ("predecessor", "successor")
DRAFTS = ("loop_constraint", "joint_constraint")
TRUTH = {"true": True, "1": True, "false": False, "0": False}


def read_urdf_plus(urdf: UrdfFile, model: pin.Model) -> Dialect:
    """Couplings, and which joints have motors."""
    for element in inner_tags(urdf.root, DRAFTS):
        raise RobotFileError(
            f"{label(element)} is not read: remove it, and write its closure into a YAML beside it"
        )
    couplings = _couplings(urdf, model)
    return Dialect(
        closures=[*couplings.values()], followers=tuple(couplings), independent=_independent(urdf)
    )


def _couplings(urdf: UrdfFile, model: pin.Model) -> dict[str, ClosureDescription]:
    """``<coupling>`` tags: gears and belts between two links, by the joint that follows.

    From the nearest link that carries both, joints lead to the predecessor and to the successor.
    The coordinates on the way to the successor add up to the ratio times those on the way to the
    predecessor.
    """
    found = {}
    for element in named_tags(urdf.root, "coupling"):
        with naming(label(element)):
            to_predecessor, to_successor = _branches(model, linked(urdf, element, ENDS))
            (ratio,) = numbers(child(element, "ratio"), "value")
            if ratio == 0:
                raise RobotFileError("<ratio> is zero")
            joints = dict.fromkeys(to_successor, 1.0) | dict.fromkeys(to_predecessor, -ratio)
            content = {"type": "coupling", "name": required(element, "name"), "joints": joints}
            found[to_successor[-1]] = validated(ClosureDescription, content)
    return found


def _branches(model: pin.Model, ends: tuple[str, str]) -> list[list[str]]:
    """Joints that move two links against the nearest link that carries both."""
    frames = [model.frames[model.getFrameId(link, pin.FrameType.BODY)] for link in ends]
    paths = [list(model.supports[frame.parentJoint]) for frame in frames]  # from the root on
    branches = []
    for path, other, side, link in zip(paths, paths[::-1], ENDS, ends, strict=True):
        branch = [joint for joint in path if joint not in other]
        if not branch:
            raise RobotFileError(f"no joint moves its {side} {link!r} against the other link")
        for joint in branch:
            if model.joints[joint].nv > 1:
                what = f"joint {model.names[joint]} on the way to its {side}"
                raise RobotFileError(f"{what} has several coordinates")
        branches.append([model.names[joint] for joint in branch])
    return branches


def _independent(urdf: UrdfFile) -> dict[str, bool]:
    """Which joints have motors, where they say so."""
    found = {}
    for joint in urdf.root.findall("joint[@independent]"):
        text = joint.get("independent", "").strip()
        if text.lower() not in TRUTH:
            raise RobotFileError(f"{label(joint)}: independent must be true or false, not {text!r}")
        found[joint.get("name", "").strip()] = TRUTH[text.lower()]
    return found
