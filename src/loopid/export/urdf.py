"""Inertials of a URDF: tensors along the axes of the origin, which stay."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from lxml import etree

from loopid.arguments import FloatArray
from loopid.inertia import Inertial, written
from loopid.loading.urdf_tree import MOMENTS, read_urdf_file


class UrdfInertials:
    """The inertials of a URDF that are not all zero."""

    def __init__(self, path: Path) -> None:
        self.path, found = path, dict[str, Inertial]()
        for link in read_urdf_file(path).robot.links:
            own = link.inertial
            if own is not None and (own.mass or own.inertia.any()):
                T = np.eye(4) if own.origin is None else own.origin
                found[link.name] = Inertial(own.mass, T[:3, 3], T[:3, :3], own.inertia)
        self.inertials = found

    def replaced(self, new: Mapping[str, FloatArray]) -> bytes:
        """Content of the file with new pseudo-inertias (4, 4), each seen from its link."""
        tree = etree.parse(self.path, etree.XMLParser(resolve_entities=False))
        space = etree.QName(tree.getroot()).namespace  # simulators declare a default one
        for link in tree.getroot().findall("{*}link"):
            name = link.get("name", "").strip()
            if name in new and etree.QName(link).namespace == space:
                old = self.inertials[name]
                _edit(link, old, Inertial.of(new[name], old.axes))
        return etree.tostring(tree, encoding=tree.docinfo.encoding, xml_declaration=True)


def _edit(link: etree._Element, old: Inertial, new: Inertial) -> None:
    """Write the numbers that change."""
    inertial, heavier, moved, turned = _child(link, "inertial"), *old.changes_to(new)
    if heavier:
        _child(inertial, "mass").set("value", written(new.mass))
    for key in MOMENTS:
        place = "xyz".index(key[1]), "xyz".index(key[2])
        if turned[place]:
            _child(inertial, "inertia").set(key, written(new.tensor[place]))
    if moved:
        if inertial.find("{*}origin") is None:
            tag = etree.QName(etree.QName(inertial).namespace, "origin")
            inertial.insert(0, etree.Element(tag))
        _child(inertial, "origin").set("xyz", written(*new.centre))


def _child(element: etree._Element, tag: str) -> etree._Element:
    """The child of a tag, in whatever namespace: whoever has read the file has found it."""
    return next(element.iterchildren(f"{{*}}{tag}"))
