"""URDF+ [Chignoli2024]: ``<coupling>``, and joints that are ``independent``."""

from __future__ import annotations

import pinocchio as pin

from loopid.border import validated
from loopid.errors import RobotFileError, naming
from loopid.loading.description import ClosureDescription
from loopid.loading.urdf import SEVERAL, Dialect, linked
from loopid.loading.urdf_tree import Joint, UrdfFile
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
    couplings = _couplings(urdf)
    return Dialect(
        closures=[*couplings.values()], followers=tuple(couplings), independent=_independent(urdf)
    )


def _couplings(urdf: UrdfFile) -> dict[str, ClosureDescription]:
    """``<coupling>`` tags: gears and belts between two links, by the joint that follows.

    From the nearest link that carries both, joints lead to the predecessor and to the successor.
    The coordinates on the way to the successor add up to the ratio times those on the way to the
    predecessor.
    """
    found = {}
    for element in named_tags(urdf.root, "coupling"):
        with naming(label(element)):
            to_predecessor, to_successor = _branches(urdf, linked(urdf, element, ENDS))
            (ratio,) = numbers(child(element, "ratio"), "value")
            if ratio == 0:
                raise RobotFileError("<ratio> is zero")
            joints = dict.fromkeys(to_successor, 1.0) | dict.fromkeys(to_predecessor, -ratio)
            content = {"type": "coupling", "name": required(element, "name"), "joints": joints}
            found[to_successor[-1]] = validated(ClosureDescription, content)
    return found


def _branches(urdf: UrdfFile, ends: tuple[str, str]) -> list[list[str]]:
    """Joints that move two links against the nearest link that carries both."""
    carriers = {joint.child: joint for joint in urdf.joints}
    paths: list[list[Joint]] = [[], []]  # from the root to each link
    for path, link in zip(paths, ends, strict=True):
        while link in carriers:
            path.insert(0, carriers[link])
            link = carriers[link].parent
    shared = {joint.name for joint in paths[0]} & {joint.name for joint in paths[1]}
    branches = []
    for path, side, link in zip(paths, ENDS, ends, strict=True):
        branch = [joint for joint in path if joint.name not in shared and joint.type != "fixed"]
        if not branch:
            raise RobotFileError(f"no joint moves its {side} {link!r} against the other link")
        for joint in branch:
            if joint.type in SEVERAL:
                what = f"joint {joint.name} on the way to its {side} is {joint.type}"
                raise RobotFileError(f"{what}: it has several coordinates")
        branches.append([joint.name for joint in branch])
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
