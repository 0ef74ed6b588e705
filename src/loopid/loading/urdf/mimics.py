"""``<mimic>``: joints that follow another one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription

SEVERAL = ("floating", "planar")  # types of joints with several coordinates


def find_mimics(joints: Iterable[Any]) -> list[tuple[str, ClosureDescription]]:
    """Joints that follow another one, each with its coupling.

    A follower may lead others. Fixed joints have nothing to follow with: their tag says nothing.

    Raises
    ------
    RobotFileError
        Naming joints that follow themselves, or nothing that moves.
    """
    by_name = {joint.name: joint for joint in joints}
    followers = [joint for joint in by_name.values() if joint.mimic and joint.type != "fixed"]
    for joint in followers:
        _check_leader(joint, by_name)
    leaders = {joint.name: joint.mimic.joint for joint in followers}
    for follower in leaders:
        _check_chain(follower, leaders)
    return [(joint.name, _coupling(joint)) for joint in followers]


def _check_leader(joint: Any, by_name: dict[str, Any]) -> None:
    leader = by_name.get(joint.mimic.joint)
    what = f"joint {joint.name} mimics {joint.mimic.joint!r}"
    if leader is None:
        raise RobotFileError(f"{what}, which is not there: choose among {', '.join(by_name)}")
    if leader.type == "fixed":
        raise RobotFileError(f"{what}, which is fixed")
    for end in (joint, leader):
        if end.type in SEVERAL:
            raise RobotFileError(
                f"{what}, but {end.name} is {end.type}: it has several coordinates"
            )


def _check_chain(follower: str, leaders: dict[str, str]) -> None:
    chain = [follower]
    while chain[-1] in leaders:
        chain.append(leaders[chain[-1]])
        if chain[-1] == follower:
            raise RobotFileError(
                f"joint {' mimics '.join(chain)}: a circle, with no joint to lead it"
            )
        if chain[-1] in chain[:-1]:
            return  # Into a circle of others, which is refused on its own.


def _coupling(joint: Any) -> ClosureDescription:
    """From follower = multiplier · leader + offset."""
    coefficients = {joint.name: 1.0, joint.mimic.joint: -joint.mimic.multiplier}
    return ClosureDescription(
        type="coupling",
        joints={name: value for name, value in coefficients.items() if value != 0},
        offset=joint.mimic.offset,
    )
