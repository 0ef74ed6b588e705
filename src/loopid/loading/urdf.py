"""Read a URDF with yourdfpy and check everything that Pinocchio takes on trust."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from loopid.errors import RobotFileError

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


@dataclass(frozen=True)
class UrdfContent:
    """What the loader needs to know beyond Pinocchio's model.

    Attributes
    ----------
    name : str
        Of the robot.
    inertial_links : tuple of str
        Links with an ``<inertial>``, in the order of the file. One that is all zero on a link
        mounted by a fixed joint only marks a frame, and does not count.
    child_links : dict
        Joint name to the link that it carries, fixed joints included.
    mimics : dict
        Joint name to the joint that it mimics.
    """

    name: str
    inertial_links: tuple[str, ...]
    child_links: dict[str, str]
    mimics: dict[str, str]


def read_urdf(path: Path) -> UrdfContent:
    """Parse and validate a URDF file.

    Raises
    ------
    RobotFileError
        Naming the file, the link or joint and the offending value.
    """
    robot = _parse(path)
    try:
        _check_names(robot)
        _check_tree(robot)
        for joint in robot.joints:
            _check_joint(joint)
        bodies = [link for link in robot.links if not _is_empty_frame(robot, link)]
        for link in bodies:
            _check_inertial(link)
    except RobotFileError as error:
        raise RobotFileError(f"{path}: {error}") from error
    return UrdfContent(
        name=robot.name or path.stem,
        inertial_links=tuple(link.name for link in bodies if link.inertial is not None),
        child_links={joint.name: joint.child for joint in robot.joints},
        mimics={joint.name: joint.mimic.joint for joint in robot.joints if joint.mimic},
    )


def _parse(path: Path) -> Any:
    # Imported here: it takes a second, and only loading needs it.
    from yourdfpy import URDF

    _check_grammar(path)
    try:
        urdf = URDF.load(
            str(path), build_scene_graph=False, load_meshes=False, load_collision_meshes=False
        )
    except Exception as error:
        # yourdfpy lets lxml's, NumPy's and its own lookup errors through as they come.
        reason = " ".join(str(error).split()) or type(error).__name__
        missing = isinstance(error, KeyError | AttributeError | TypeError)
        hint = f"a tag or attribute is missing ({reason})" if missing else reason
        raise RobotFileError(f"{path} is not a valid URDF: {hint}") from error
    if not urdf.robot.links:
        raise RobotFileError(f"{path} has no <link>")
    return urdf.robot


def _check_grammar(path: Path) -> None:
    """Refuse what yourdfpy would repair; prefixes without a namespace are common and harmless."""
    try:
        etree.parse(str(path))
    except etree.XMLSyntaxError as error:
        if error.code != etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE:
            raise RobotFileError(f"{path} is not a valid URDF: {error.msg}") from error


def _check_names(robot: Any) -> None:
    for tag, elements in (("link", robot.links), ("joint", robot.joints)):
        for name, count in Counter(element.name for element in elements).items():
            if count > 1:
                raise RobotFileError(f"<{tag} name={name!r}> appears {count} times")


def _check_tree(robot: Any) -> None:
    links = {link.name for link in robot.links}
    for joint in robot.joints:
        for end in (joint.parent, joint.child):
            if end not in links:
                raise RobotFileError(f"joint {joint.name} names link {end!r}, which is not there")
    parents = Counter(joint.child for joint in robot.joints)
    for child, count in parents.items():
        if count > 1:
            raise RobotFileError(f"link {child} is the child of {count} joints: not a tree")
    roots = sorted(links - set(parents))
    if len(roots) != 1:
        listed = ", ".join(roots) or "none"
        raise RobotFileError(f"the links must form one tree with one root, but roots are: {listed}")
    _check_reachable(robot, roots[0], links)


def _check_reachable(robot: Any, root: str, links: set[str]) -> None:
    reached, waiting = {root}, [root]
    while waiting:
        parent = waiting.pop()
        children = [joint.child for joint in robot.joints if joint.parent == parent]
        reached.update(children)
        waiting.extend(children)
    if reached != links:
        lost = ", ".join(sorted(links - reached))
        raise RobotFileError(f"links {lost} hang on a cycle of joints, not on root {root}")


def _check_joint(joint: Any) -> None:
    what = f"joint {joint.name}"
    if joint.type not in JOINT_TYPES:
        listed = ", ".join(JOINT_TYPES)
        raise RobotFileError(f"{what}: unknown type {joint.type!r}: choose among {listed}")
    _require_finite(f"{what}: <origin>", joint.origin)
    if joint.type in ("fixed", "floating"):
        return
    _require_finite(f"{what}: <axis>", joint.axis)
    if joint.axis is not None and len(joint.axis) != 3:
        raise RobotFileError(f"{what}: <axis> must be three numbers, not {len(joint.axis)}")
    if joint.axis is not None and not np.linalg.norm(joint.axis) > 1e-9:
        raise RobotFileError(f"{what}: <axis> is zero")
    if joint.limit is None:
        if joint.type in ("revolute", "prismatic"):
            raise RobotFileError(f"{what}: a {joint.type} joint needs a <limit>")
        return
    bounds = [bound for bound in (joint.limit.lower, joint.limit.upper) if bound is not None]
    _require_finite(f"{what}: <limit>", bounds)
    if len(bounds) == 2 and bounds[0] > bounds[1]:
        raise RobotFileError(f"{what}: <limit> lower {bounds[0]} exceeds upper {bounds[1]}")


def _is_empty_frame(robot: Any, link: Any) -> bool:
    if link.inertial is None or link.inertial.mass != 0 or np.any(link.inertial.inertia):
        return False
    return all(joint.type == "fixed" for joint in robot.joints if joint.child == link.name)


def _check_inertial(link: Any) -> None:
    if link.inertial is None:
        return
    what, mass = f"link {link.name}", link.inertial.mass
    if mass is None:
        raise RobotFileError(f"{what}: <inertial> has no <mass>")
    _require_finite(f"{what}: <mass>", [mass])
    if mass <= 0:
        raise RobotFileError(
            f"{what}: mass must be positive, not {mass:g} kg (leave <inertial> out of a link "
            "without mass)"
        )
    _require_finite(f"{what}: <inertia>", link.inertial.inertia)
    _require_finite(f"{what}: <inertial> <origin>", link.inertial.origin)


def _require_finite(what: str, values: np.ndarray[Any, Any] | Iterable[float] | None) -> None:
    if values is not None and not np.isfinite(np.asarray(values, dtype=np.float64)).all():
        raise RobotFileError(f"{what} must be finite numbers")
