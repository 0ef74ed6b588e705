"""``<coupling>`` tags of URDF+: gears and belts between two links [Chignoli2024]."""

from __future__ import annotations

from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription
from loopid.loading.urdf.ends import SIDES, ends, named_tags
from loopid.loading.urdf.markup import Element, label, numbers
from loopid.loading.urdf.mimics import SEVERAL
from loopid.loading.urdf.robot import Joint, Robot


def read_couplings(root: Element, robot: Robot) -> list[tuple[str, ClosureDescription]]:
    """Closures of the ``<coupling>`` tags, each with the joint that carries its successor.

    From the nearest link that carries both, joints lead to the predecessor and to the successor.
    The coordinates on the way to the successor add up to the ratio times those on the way to the
    predecessor.

    Raises
    ------
    RobotFileError
        Naming the coupling, the tag and the value.
    """
    return [_read(element, robot) for element in named_tags(root, "coupling")]


def _read(element: Element, robot: Robot) -> tuple[str, ClosureDescription]:
    links = ends(element, [link.name for link in robot.links])
    try:
        to_predecessor, to_successor = _branches(robot, *links)
        ratio = _ratio(element)
    except RobotFileError as error:
        raise RobotFileError(f"{label(element)}: {error}") from error
    joints = dict.fromkeys(to_successor, 1.0) | dict.fromkeys(to_predecessor, -ratio)
    return to_successor[-1], ClosureDescription(type="coupling", joints=joints)


def _ratio(coupling: Element) -> float:
    ratio = coupling.find("ratio")
    if ratio is None:
        raise RobotFileError("<ratio> is missing")
    (value,) = numbers(ratio, "value")
    if value == 0:
        raise RobotFileError("<ratio> is zero")
    return value


def _branches(robot: Robot, predecessor: str, successor: str) -> list[list[str]]:
    """Joints that move two links against the nearest link that carries both."""
    paths = [_path(robot, link) for link in (predecessor, successor)]
    shared = {joint.name for joint in paths[0]} & {joint.name for joint in paths[1]}
    branches = [[joint for joint in path if joint.name not in shared] for path in paths]
    return [
        _simple(side, link, branch)
        for side, link, branch in zip(SIDES, (predecessor, successor), branches, strict=True)
    ]


def _path(robot: Robot, link: str) -> list[Joint]:
    """Joints from the root to a link."""
    carriers = {joint.child: joint for joint in robot.joints}
    path = []
    while link in carriers:
        path.append(carriers[link])
        link = carriers[link].parent
    return path[::-1]


def _simple(side: str, link: str, branch: list[Joint]) -> list[str]:
    moving = [joint for joint in branch if joint.type != "fixed"]
    if not moving:
        raise RobotFileError(f"no joint moves its {side} {link!r} against the other link")
    for joint in moving:
        if joint.type in SEVERAL:
            what = f"joint {joint.name} on the way to its {side} is {joint.type}"
            raise RobotFileError(f"{what}: it has several coordinates")
    return [joint.name for joint in moving]
