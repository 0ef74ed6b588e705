"""Links that a robot file declares identical."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from loopid.errors import RobotFileError
from loopid.loading.source import TreeSource
from loopid.robot import Body, LinkGroup


def find_groups(
    file: Path, tree: TreeSource, identical: Mapping[str, Sequence[str]], bodies: Sequence[Body]
) -> tuple[LinkGroup, ...]:
    """Groups of links, each with parameters of its own.

    Raises
    ------
    RobotFileError
        When a link is unknown or without parameters, or a group is named like another link.
    """
    links = [body.link for body in bodies]
    groups = []
    for name, members in identical.items():
        for link in members:
            if link not in links:
                known = "has no parameters of its own" if link in _all(tree) else "is unknown"
                raise RobotFileError(
                    f"{file}: identical: link {link!r} of {name} {known}: choose among "
                    f"{', '.join(links)}"
                )
        if name in links and name not in members:
            raise RobotFileError(f"{file}: identical: group {name} is named like another link")
        groups.append(LinkGroup(name, tuple(members)))
    return tuple(groups)


def _all(tree: TreeSource) -> set[str]:
    return {frame.name for frame in tree.model.frames}
