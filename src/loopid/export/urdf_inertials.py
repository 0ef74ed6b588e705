"""The ``<inertial>`` tags of a URDF: read, and written anew in place."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from html import unescape
from pathlib import Path

import numpy as np

from loopid.arrays import FloatArray
from loopid.consistency.moments import pseudo_inertia_of
from loopid.errors import RobotFileError
from loopid.export.inertias import (
    central_moments,
    centre,
    inertia_tensor,
    second_moments,
)
from loopid.export.located_xml import Edit, LocatedXml, Tag, locate
from loopid.export.written import centre_changes, mass_changes, number, tensor_changes
from loopid.export.written import numbers as written
from loopid.loading import read_urdf_file
from loopid.loading.urdf_file import MOMENTS

PLACES = tuple(("xyz".index(key[1]), "xyz".index(key[2])) for key in MOMENTS)


@dataclass(frozen=True)
class UrdfInertial:
    """An ``<inertial>``: mass, centre of mass, axes and moments along them.

    Attributes
    ----------
    mass : float
    centre : FloatArray
        (3,), in the frame of the link.
    axes : FloatArray
        (3, 3), rotation of the ``rpy`` of its origin.
    tensor : FloatArray
        (3, 3), about the centre, along the axes.
    """

    mass: float
    centre: FloatArray
    axes: FloatArray
    tensor: FloatArray

    @property
    def inertia(self) -> FloatArray:
        """(4, 4), seen from the link."""
        second = second_moments(self.axes @ self.tensor @ self.axes.T)
        return pseudo_inertia_of(self.mass, self.centre, second)

    def replaced(self, inertia: FloatArray) -> UrdfInertial:
        """The numbers of another inertia along the same axes."""
        tensor = self.axes.T @ inertia_tensor(central_moments(inertia)) @ self.axes
        return UrdfInertial(float(inertia[3, 3]), centre(inertia), self.axes, tensor)


def read_inertials(path: Path) -> dict[str, UrdfInertial]:
    """The inertials of all links that have one which is not all zero."""
    inertials = {link.name: link.inertial for link in read_urdf_file(path).robot.links}
    return {
        name: UrdfInertial(
            inertial.mass, placement[:3, 3].copy(), placement[:3, :3].copy(), inertial.inertia
        )
        for name, inertial in inertials.items()
        if inertial is not None and (inertial.mass or inertial.inertia.any())
        for placement in [np.eye(4) if inertial.origin is None else inertial.origin]
    }


def rewritten(
    content: bytes, old: Mapping[str, UrdfInertial], new: Mapping[str, FloatArray]
) -> bytes:
    """The content of a URDF with new inertias (4, 4) of some links, otherwise the same bytes."""
    xml = locate(content)
    tags = {_name(xml, link): link.find("inertial") for link in xml.root.find_all("link")}
    edits: list[Edit] = []
    for name, inertia in new.items():
        tag = tags.get(name)
        if tag is None:
            raise RobotFileError(f"link {name} and its <inertial> are not where they should be")
        edits += _edits(xml, tag, old[name], old[name].replaced(inertia))
    return xml.edited(edits)


def _name(xml: LocatedXml, link: Tag) -> str:
    """A name as a parser would read it."""
    written = xml.value(link, "name") or ""
    return unescape(" ".join(re.split(r"\r\n|[\t\r\n ]", written))).strip()


def _edits(xml: LocatedXml, inertial: Tag, old: UrdfInertial, new: UrdfInertial) -> list[Edit]:
    mass, inertia, origin = (inertial.find(tag) for tag in ("mass", "inertia", "origin"))
    if mass is None or inertia is None:
        raise RobotFileError("an <inertial> has no <mass> or no <inertia>")
    edits, P = [], new.inertia
    if mass_changes(old.mass, P):
        edits.append(xml.replaced(mass, "value", number(new.mass)))
    changed = tensor_changes(new.tensor - old.tensor, P)
    for place, key in zip(PLACES, MOMENTS, strict=True):
        if changed[place]:
            edits.append(xml.replaced(inertia, key, number(new.tensor[place])))
    if centre_changes(old.centre, P):
        xyz = written(new.centre)
        if origin is None:
            edits.append(xml.added(inertial, f'<origin xyz="{xyz}"/>'))
        else:
            edits.append(xml.replaced(origin, "xyz", xyz))
    return edits
