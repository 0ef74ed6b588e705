"""``<mimic>``: joints that follow another one."""

from __future__ import annotations

from collections.abc import Iterable

from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription
from loopid.loading.urdf.robot import Joint, Mimic

SEVERAL = ("floating", "planar")  # types of joints with several coordinates


def find_mimics(joints: Iterable[Joint]) -> list[tuple[str, ClosureDescription]]:
    """Joints that follow another one, each with its coupling.

    A follower may lead others. Fixed joints have nothing to follow with: their tag says nothing.

    Raises
    ------
    RobotFileError
        Naming joints that follow themselves, or nothing that moves.
    """
    by_name = {joint.name: joint for joint in joints}
    mimics = {
        name: joint.mimic
        for name, joint in by_name.items()
        if joint.mimic is not None and joint.type != "fixed"
    }
    for name, mimic in mimics.items():
        _check_leader(by_name[name], mimic.joint, by_name)
    leaders = {name: mimic.joint for name, mimic in mimics.items()}
    for follower in leaders:
        _check_chain(follower, leaders)
    return [(name, _coupling(name, mimic)) for name, mimic in mimics.items()]


def _check_leader(joint: Joint, leading: str, by_name: dict[str, Joint]) -> None:
    leader = by_name.get(leading)
    what = f"joint {joint.name} mimics {leading!r}"
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


def _coupling(follower: str, mimic: Mimic) -> ClosureDescription:
    """From follower = multiplier · leader + offset."""
    coefficients = {follower: 1.0, mimic.joint: -mimic.multiplier}
    return ClosureDescription(
        type="coupling",
        joints={name: value for name, value in coefficients.items() if value != 0},
        offset=mimic.offset,
    )
