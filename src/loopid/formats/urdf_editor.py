"""A URDF with other inertials and joint terms; tags, comments, order and encoding stay."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from lxml import etree

from loopid.arguments import FloatArray, number
from loopid.inertia import Inertial, written
from loopid.loading.urdf import COEFFICIENTS, ROTORS, read_urdf
from loopid.loading.urdf_tree import MOMENTS, read_urdf_file
from loopid.loading.xml_elements import Element, inner_tags, local_name, read_xml

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
        own = self.joint_terms(content) if terms else {}
        root = read_xml(self.path, whole=True)
        tree = root.getroottree()
        space = etree.QName(root).namespace  # simulators declare a default one
        for element in root.iterchildren("{*}link", "{*}joint"):
            name = element.get("name", "").strip()
            if etree.QName(element).namespace != space:
                continue
            if local_name(element) == "joint" and name in terms:
                _edit_joint(root, element, terms[name], own.get(name, {}))
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


def _edit_joint(
    root: Element, joint: Element, terms: Mapping[str, float], own: Mapping[str, float]
) -> None:
    """Write terms of a joint into all tags that say them; ``own`` are those of the file."""
    values, places = dict(terms), list(_places(root, joint))
    said = {COEFFICIENTS[key] for _, key in places}
    if values.get("Ks"):
        values["slack"] = -values.get("Fo", 0.0) / values["Ks"]
        if values["slack"] and "slack" not in said:
            del values["Ks"]  # slack elsewhere, it would be another spring
    rotors = list(_rotors(root, joint))
    if rotors and "Ia" in values and own.get("Ia"):  # they add to what the joint says itself
        ratio = values.pop("Ia") / own["Ia"]
        armatures = [place for place in places if COEFFICIENTS[place[1]] == "Ia"]
        for element, key in (*rotors, *armatures):
            _write(element, key, ratio * _read(element, key))
    for element, key in places:
        if (value := values.get(COEFFICIENTS[key])) is not None:
            _write(element, key, value)
    for kind, key in DYNAMICS.items():
        if values.get(kind) and kind not in said:
            _dynamics(joint).set(key, written(values[kind]))


def _places(root: Element, joint: Element) -> Iterator[tuple[Element, str]]:
    """Tags of a joint that say a coefficient, with the name of the attribute or tag."""
    for dynamics in joint.iterchildren("{*}dynamics"):
        yield from ((dynamics, str(key)) for key in dynamics.attrib if key in COEFFICIENTS)
    name = joint.get("name", "").strip()
    beside = (tag for tag in root.iterchildren("{*}gazebo") if tag.get("reference", "") == name)
    for element in (joint, *beside):
        yield from ((tag, local_name(tag)) for tag in inner_tags(element, COEFFICIENTS))


def _rotors(root: Element, joint: Element) -> Iterator[tuple[Element, str]]:
    """Tags of rotors of transmissions to this joint alone."""
    for transmission in root.iter("{*}transmission"):
        driven = {tag.get("name", "").strip() for tag in inner_tags(transmission, ("joint",))}
        if driven == {joint.get("name", "").strip()}:
            yield from ((tag, local_name(tag)) for tag in inner_tags(transmission, ROTORS))


def _read(element: Element, key: str) -> float:
    return number(element.get(key) or element.get("value") or element.text or "")


def _write(element: Element, key: str, value: float) -> None:
    """Write a number where ``_read`` finds it: an attribute of the name, a value, or a text."""
    for name in (key, "value"):
        if element.get(name):
            element.set(name, written(value))
            return
    element.text = written(value)


def _dynamics(joint: Element) -> Element:
    """The tag for friction, added at the end of a joint that has none."""
    for found in joint.iterchildren("{*}dynamics"):
        return found
    added = etree.SubElement(joint, etree.QName(etree.QName(joint).namespace, "dynamics"))
    before = added.getprevious()
    if before is not None:  # as its neighbours are indented
        added.tail, before.tail = before.tail, joint.text
    return added
