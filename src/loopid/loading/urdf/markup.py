"""The XML of a URDF: parsed strictly, cut down to the tree, its numbers checked."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lxml import etree

from loopid.errors import RobotFileError
from loopid.loading.urdf.angles import exact_angle

Element = etree._Element
# What the tree is made of. Geometry, materials and extensions may be broken without harm.
TREE: dict[str, Any] = {
    "link": {"inertial": {"origin": {}, "mass": {}, "inertia": {}}},
    "joint": {tag: {} for tag in ("origin", "parent", "child", "axis", "limit", "mimic")},
}
WORDS = {1: "a finite number", 3: "three finite numbers"}
LARGEST = 1e100  # so that no product of a few numbers overflows


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the file in front of whatever is refused inside."""
    try:
        yield
    except RobotFileError as error:
        raise RobotFileError(f"{path}: {error}") from error


def parse_xml(path: Path) -> Element:
    """Root of a URDF, comments left out.

    Prefixes without a namespace are common, and harmless; other broken grammar is refused.
    """
    content = _content(path)
    try:
        root = etree.fromstring(content, _parser(recover=False))
    except etree.XMLSyntaxError as error:
        if error.code != etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE:
            raise RobotFileError(f"not a valid URDF: {error.msg}") from error
        root = etree.fromstring(content, _parser(recover=True))
    _leave_namespace(root)
    if root.tag != "robot":
        raise RobotFileError(f"not a valid URDF: the root is <{root.tag!s}>, not <robot>")
    return root


def _leave_namespace(root: Element) -> None:
    """Give tags of the default namespace, which some simulators declare, their bare names."""
    space = f"{{{root.nsmap.get(None)}}}"
    for element in root.iter(f"{space}*"):
        element.tag = str(element.tag).removeprefix(space)


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise RobotFileError(f"cannot be read: {error.strerror}") from error


def _parser(recover: bool) -> etree.XMLParser[Element]:
    return etree.XMLParser(
        recover=recover,
        remove_comments=True,
        remove_pis=True,
        resolve_entities=False,
        no_network=True,
    )


def tree_part(root: Element) -> Element:
    """Copy of a URDF with links, joints and what the tree needs of them, and nothing else."""
    part = etree.Element("robot", {"name": " ".join(root.get("name", "").split())})
    _graft(part, root, TREE)
    return part


def _graft(target: Element, source: Element, tags: dict[str, Any]) -> None:
    for element in source:
        if element.tag in tags:
            copy = etree.SubElement(target, str(element.tag), _plain_attributes(element))
            _graft(copy, element, tags[str(element.tag)])


def _plain_attributes(element: Element) -> dict[str, str]:
    """Attributes without a prefix, which would need its namespace."""
    pairs = ((str(key), str(value).strip()) for key, value in element.attrib.items())
    return {key: value for key, value in pairs if not {":", "}"} & set(key)}


def label(element: Element) -> str:
    """A tag with its name, for messages."""
    name = element.get("name")
    return f"<{element.tag!s}>" if name is None else f"<{element.tag!s} name={name!r}>"


def required(element: Element, attribute: str) -> str:
    """Text of an attribute that has to be there."""
    text = (element.get(attribute) or "").strip()
    if not text:
        raise RobotFileError(f"{label(element)} has no {attribute}")
    if not text.isprintable():
        raise RobotFileError(f"{label(element)}: {attribute} must be printable, not {text!r:.60}")
    return text


def numbers(
    element: Element, attribute: str, count: int = 1, default: str | None = None
) -> tuple[float, ...]:
    """Numbers of an attribute, which has to be there unless it has a default.

    Raises
    ------
    RobotFileError
        Naming tag and attribute, unless there are as many as asked for, all of them finite.
    """
    text = element.get(attribute, default)
    if text is None:
        raise RobotFileError(f"<{element.tag!s}> has no {attribute}")
    try:
        read = exact_angle if attribute == "rpy" else float
        values = tuple(read(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        what = f"<{element.tag!s}> {attribute}"
        raise RobotFileError(f"{what} must be {WORDS[count]}, not {text!r:.60}")
    # Limits are often the largest number there is.
    if element.tag != "limit" and max(map(abs, values)) > LARGEST:
        raise RobotFileError(f"<{element.tag!s}> {attribute} is too large: {text}")
    return values
