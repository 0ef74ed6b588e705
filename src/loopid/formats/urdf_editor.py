"""A URDF with other inertials and friction; tags, comments, order and encoding stay."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from lxml import etree

from loopid.arguments import FloatArray
from loopid.inertia import Inertial, written
from loopid.loading.urdf import read_urdf
from loopid.loading.urdf_tree import MOMENTS, read_urdf_file
from loopid.loading.xml_elements import Element, local_name, read_xml

# Attributes of <dynamics> that every URDF has a place for.
DYNAMICS = {"Fv": "damping", "Fc": "friction"}


class UrdfEditor:
    """Inertials of a URDF that are not all zero, along the axes of the origin; its joint terms."""

    def __init__(self, path: Path) -> None:
        self.path = path
        bodies = {link.name: link.inertial for link in read_urdf_file(path).links}
        self.inertials = {
            name: own
            for name, own in bodies.items()
            if own is not None and (own.mass or own.tensor.any())
        }

    def joint_terms(self, content: bytes) -> Mapping[str, Mapping[str, float]]:
        """Values of terms, by joint and kind, that content of the file says."""
        with TemporaryDirectory() as folder, warnings.catch_warnings(action="ignore"):
            place = Path(folder) / self.path.name
            place.write_bytes(content)
            return read_urdf(place).description.joint_terms  # type: ignore[return-value]

    def edited(
        self, inertials: Mapping[str, FloatArray], terms: Mapping[str, Mapping[str, float]]
    ) -> bytes:
        """Content with other pseudo-inertias (4, 4) of links, and terms of joints."""
        content = self.path.read_bytes()
        if not (inertials or terms):
            return content
        root = read_xml(self.path, whole=True)
        tree = root.getroottree()
        space = etree.QName(root).namespace  # simulators declare a default one
        for element in root.iterchildren("{*}link", "{*}joint"):
            name = element.get("name", "").strip()
            if etree.QName(element).namespace != space:
                continue
            if local_name(element) == "joint" and name in terms:
                _edit_joint(element, terms[name])
            elif local_name(element) == "link" and name in inertials:
                old = self.inertials[name]
                _edit_inertial(element, old, Inertial.of(inertials[name], old.axes))
        return etree.tostring(tree, encoding=tree.docinfo.encoding, xml_declaration=True)


def _edit_inertial(link: Element, old: Inertial, new: Inertial) -> None:
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


def _child(element: Element, tag: str) -> Element:
    """The child of a tag, in whatever namespace: whoever has read the file has found it."""
    return next(element.iterchildren(f"{{*}}{tag}"))


def _edit_joint(joint: Element, terms: Mapping[str, float]) -> None:
    """Write friction of a joint where it says some, or has some."""
    for kind, key in DYNAMICS.items():
        said = any(key in tag.attrib for tag in joint.iterchildren("{*}dynamics"))
        if kind in terms and (said or terms[kind]):
            _dynamics(joint).set(key, written(terms[kind]))


def _dynamics(joint: Element) -> Element:
    """The tag for friction, added at the end of a joint that has none."""
    for found in joint.iterchildren("{*}dynamics"):
        return found
    added = etree.SubElement(joint, etree.QName(etree.QName(joint).namespace, "dynamics"))
    before = added.getprevious()
    if before is not None:  # as its neighbours are indented
        added.tail, before.tail = before.tail, joint.text
    return added
