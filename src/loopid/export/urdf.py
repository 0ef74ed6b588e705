"""The ``<inertial>`` tags of a URDF: read, and written anew in place."""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import unescape
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import RobotFileError
from loopid.export.inertials import Inertial, require_faithful, updated_inertials
from loopid.export.located_xml import Edit, LocatedXml, Tag, locate, written
from loopid.loading import read_urdf_file
from loopid.loading.urdf import MOMENTS
from loopid.parameters import ParameterSet
from loopid.robot import Mechanism

PLACES = {key: ("xyz".index(key[1]), "xyz".index(key[2])) for key in MOMENTS}


def updated_urdf(
    mechanism: Mechanism, tree: Path, values: FloatArray, parameters: ParameterSet | None
) -> bytes:
    """Content of a URDF with the inertials of its links updated; see ``updated_robot_file``."""
    old = _read(tree)
    new = updated_inertials(mechanism, old, values, parameters)
    content = _rewritten(tree.read_bytes(), old, new)
    with TemporaryDirectory() as folder:
        draft = Path(folder, tree.name)
        draft.write_bytes(content)
        read = _read(draft)
    require_faithful(tree, {name: inertial.P for name, inertial in old.items()} | new, read)
    return content


def _read(path: Path) -> dict[str, Inertial]:
    """The inertials of all links that have one which is not all zero."""
    found = {}
    for link in read_urdf_file(path).robot.links:
        own = link.inertial
        if own is not None and (own.mass or own.inertia.any()):
            T = np.eye(4) if own.origin is None else own.origin
            found[link.name] = Inertial(own.mass, T[:3, 3].copy(), T[:3, :3].copy(), own.inertia)
    return found


def _rewritten(content: bytes, old: Mapping[str, Inertial], new: Mapping[str, FloatArray]) -> bytes:
    """The content with new pseudo-inertias (4, 4) of some links, otherwise the same bytes."""
    xml = locate(content)
    tags = {_name(xml, link): link.find("inertial") for link in xml.root.find_all("link")}
    edits: list[Edit] = []
    for name, P in new.items():
        tag = tags.get(name)
        if tag is None:
            raise RobotFileError(f"link {name} and its <inertial> are not where they should be")
        edits += _edits(xml, tag, old[name], old[name].replaced(P))
    return xml.edited(edits)


def _name(xml: LocatedXml, link: Tag) -> str:
    """A name as a parser would read it."""
    given = xml.value(link, "name") or ""
    return unescape(" ".join(re.split(r"\r\n|[\t\r\n ]", given))).strip()


def _edits(xml: LocatedXml, inertial: Tag, old: Inertial, new: Inertial) -> list[Edit]:
    mass, inertia, origin = (inertial.find(tag) for tag in ("mass", "inertia", "origin"))
    if mass is None or inertia is None:
        raise RobotFileError("an <inertial> has no <mass> or no <inertia>")
    heavier, moved, turned = old.changes_to(new)
    edits = [xml.replaced(mass, "value", written(new.mass))] if heavier else []
    edits += [
        xml.replaced(inertia, key, written(new.tensor[place]))
        for key, place in PLACES.items()
        if turned[place]
    ]
    if moved and origin is None:
        edits.append(xml.added(inertial, f'<origin xyz="{written(*new.centre)}"/>'))
    elif moved and origin is not None:
        edits.append(xml.replaced(origin, "xyz", written(*new.centre)))
    return edits
