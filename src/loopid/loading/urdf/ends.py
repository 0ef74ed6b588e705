"""What ``<loop>`` and ``<coupling>`` tags of URDF+ share: a name, a predecessor and a successor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection

from loopid.errors import RobotFileError
from loopid.loading.urdf.markup import Element, label, required

SIDES = ("predecessor", "successor")


def named_tags(root: Element, tag: str) -> list[Element]:
    """All tags of one kind, each with a name of its own.

    Raises
    ------
    RobotFileError
        Where a name is missing or not alone.
    """
    elements = root.findall(tag)
    for name, count in Counter(required(element, "name") for element in elements).items():
        if count > 1:
            raise RobotFileError(f"<{tag} name={name!r}> appears {count} times")
    return elements


def ends(element: Element, links: Collection[str]) -> tuple[str, str]:
    """Links of predecessor and successor.

    Raises
    ------
    RobotFileError
        Naming the tag, unless they are two links of the robot.
    """
    predecessor, successor = (_end(element, side, links) for side in SIDES)
    if predecessor == successor:
        what = label(element)
        raise RobotFileError(f"{what} has link {predecessor!r} as predecessor and as successor")
    return predecessor, successor


def _end(element: Element, side: str, links: Collection[str]) -> str:
    end = element.find(side)
    if end is None:
        raise RobotFileError(f"{label(element)} has no <{side}>")
    link = (end.get("link") or "").strip()
    if link not in links:
        listed = ", ".join(links)
        what = f"{label(element)}: unknown link {link!r} in <{side}>"
        raise RobotFileError(f"{what}: choose among {listed}")
    return link
