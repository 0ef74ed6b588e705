"""Loops that pairs of frames close by their names, as onshape-to-robot exports them."""

from __future__ import annotations

import re
from collections.abc import Collection

from loopid.errors import RobotFileError
from loopid.loading.closure_description import ClosureDescription

NAME = re.compile(r"closing_(.+)_([12])")
Z = (0.0, 0.0, 1.0)


def closing_frames(links: Collection[str]) -> list[ClosureDescription]:
    """Closures of the links ``closing_NAME_1`` and ``closing_NAME_2``.

    The names say that two frames meet, not by which joint. Only beside a hinge, versions of the
    exporter add a second pair of frames further along its axis, ``closing_NAME_1_z`` and
    ``closing_NAME_2_z``; without them the origins meet, which the exporter's manual has one
    enforce.

    Raises
    ------
    RobotFileError
        Where one of a pair is missing.
    """
    pairs = (match.groups() for match in map(NAME.fullmatch, links) if match is not None)
    closures = []
    for name, side in pairs:
        _require_partner(name, side, links)
        if side == "1":
            closures.append(_closure(name, links))
    return closures


def _require_partner(name: str, side: str, links: Collection[str]) -> None:
    partner = f"closing_{name}_{3 - int(side)}"
    if partner not in links:
        link = f"closing_{name}_{side}"
        raise RobotFileError(f"link {link} closes a loop with link {partner!r}, which is missing")


def _closure(name: str, links: Collection[str]) -> ClosureDescription:
    frames = (f"closing_{name}_1", f"closing_{name}_2")
    if all(f"{frame}_z" in links for frame in frames):
        return ClosureDescription(type="hinge", frames=frames, axes=(Z, Z))
    return ClosureDescription(type="3d", frames=frames)
