"""Elements of XML files: tags, names and numbers, refused by name where they are not sound."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.arguments import LARGEST
from loopid.errors import RobotFileError, shown

Element = etree._Element
REQUIRED = ("mass", "inertia", "parent", "child")  # tags that must be there, once
WORDS = {
    1: "a finite number",
    3: "three finite numbers",
    6: "six finite numbers",
    7: "seven finite numbers",
}
MOST_BYTES = 20_000_000  # of a file: far more than robots have
# Angles that lost digits in print: multiples of 5°, which people draw. Fewer decimals may be meant
# as they are written; with more, nothing is lost. In units of the last digit: 1.57079 is cut off,
# and 3.14158 is twice that.
STEP = math.pi / 36
DECIMALS = range(4, 13)
SLACK = 1.5


def read_xml(path: Path, whole: bool = False) -> Element:
    """Root of an XML file, without comments unless it is to be whole; entities are refused."""
    try:
        with path.open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
    except OSError as error:
        raise RobotFileError(f"cannot be read: {error.strerror}") from error
    return parsed_xml(content, whole)


def parsed_xml(content: bytes, whole: bool = False) -> Element:
    """Root of the text of an XML file; see ``read_xml``."""
    options: dict[str, Any] = dict.fromkeys(("remove_comments", "remove_pis"), not whole)
    options["resolve_entities"] = False
    if len(content) > MOST_BYTES:
        raise RobotFileError(f"it is longer than the {MOST_BYTES / 1e6:g} MB that are read")
    try:
        root: Element = etree.fromstring(content, etree.XMLParser(**options))
    except etree.XMLSyntaxError as error:
        if error.code != etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE:
            raise RobotFileError(f"it is no valid XML: {error.msg}") from error
        root = etree.fromstring(content, etree.XMLParser(recover=True, **options))
    declared = root.getroottree().docinfo.internalDTD
    names = [] if declared is None else [str(entity.name) for entity in declared.iterentities()]
    names += [str(entity.text)[1:-1] for entity in root.iter(etree.Entity)]
    if names:
        raise RobotFileError(
            f"XML entities are not read: write out what &{names[0]:.60}; stands for"
        )
    return root


def label(element: Element) -> str:
    """A tag with its name, for messages."""
    name = element.get("name")
    return f"<{element.tag!s}>" if name is None else f"<{element.tag!s} name={name!r}>"


def child(element: Element, tag: str) -> Element:
    """A tag that must be there."""
    found = single(element, tag)
    if found is None:
        raise RobotFileError(f"<{element.tag!s}> has no <{tag}>")
    return found


def content(element: Element, tag: str) -> str:
    """Text of a tag that must be there."""
    return (child(element, tag).text or "").strip()


def text_at(element: Element, path: str) -> str:
    """Text of a tag that may be there; empty where it is missing."""
    return (element.findtext(path) or "").strip()


def single(element: Element, tag: str) -> Element | None:
    """A tag that may be there, once; of a joint's the first counts, as for Pinocchio."""
    found = element.findall(tag)
    if len(found) > 1 and (element.tag != "joint" or tag in REQUIRED):
        raise RobotFileError(f"<{element.tag!s}> has {len(found)} times <{tag}>: keep one")
    return found[0] if found else None


def required(element: Element, attribute: str) -> str:
    """Text of an attribute that must be there."""
    text = (element.get(attribute) or "").strip()
    if not text:
        raise RobotFileError(f"{label(element)} has no {attribute}")
    if not text.isprintable():
        raise RobotFileError(f"{label(element)}: {attribute} must be printable, not {shown(text)}")
    return text


def numbers(
    element: Element, attribute: str, count: int = 1, default: str | None = None
) -> tuple[float, ...]:
    """Finite numbers of an attribute, which must be there unless it has a default."""
    text = element.get(attribute, default)
    if text is None:
        raise RobotFileError(f"<{element.tag!s}> has no {attribute}")
    # Limits are often the largest number there is.
    most = math.inf if element.tag == "limit" else LARGEST
    read = exact_angle if attribute == "rpy" else float
    return numbers_in(f"<{element.tag!s}> {attribute}", text, count, most=most, read=read)


def numbers_in(
    what: str,
    text: str,
    count: int = 1,
    *,
    most: float = LARGEST,
    read: Callable[[str], float] = float,
) -> tuple[float, ...]:
    """Finite numbers of a text."""
    # Python's 1_6 and digits of other scripts are no numbers.
    words = text.split() if text.isascii() and "_" not in text else []
    try:
        values = tuple(map(read, words))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise RobotFileError(f"{what} must be {WORDS[count]}, not {shown(text)}")
    if max(map(abs, values)) > most:
        raise RobotFileError(f"{what} is too large: {text}")
    return values


def exact_angle(text: str) -> float:
    """Angle in rad: the multiple of 5° that rounds, or is cut, to the text, else what it says.

    A quarter turn written as 1.5708 tilts an axis by 4e-6 rad. Redundant closures then contradict
    each other, and parameters without effect seem to have an effect of 1e-11.
    """
    value = float(text)
    decimals = len(text.partition(".")[2])
    steps = round(value / STEP) if abs(value) < LARGEST else 0
    if steps == 0 or decimals not in DECIMALS or not text.lstrip("+-").replace(".", "").isdigit():
        return value
    exact = steps * STEP
    return exact if abs(exact - value) < SLACK * 10.0**-decimals else value


def placement(origin: Element | None) -> pin.SE3:
    """Placement of an ``<origin>``; the identity without one."""
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (np.array(numbers(origin, key, 3, "0 0 0")) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def refuse_repetition(tag: str, names: Iterable[str]) -> None:
    """Refuse elements of one name."""
    for name, count in Counter(names).items():
        if count > 1:
            raise RobotFileError(f"<{tag} name={name!r}> appears {count} times")


def named_tags(root: Element, tag: str) -> list[Element]:
    """All tags of one kind below the root, each with a name of its own."""
    elements = root.findall(tag)
    refuse_repetition(tag, (required(element, "name") for element in elements))
    return elements


def inner_tags(element: Element, tags: Collection[str]) -> Iterator[Element]:
    """All tags of some kinds below an element, in any namespace."""
    return (found for found in element.iterdescendants("*") if local_name(found) in tags)


def local_name(element: Element) -> str:
    """A tag without its namespace or prefix."""
    return str(element.tag).rpartition("}")[2].rpartition(":")[2]


def said(element: Element, *tags: str) -> str:
    """The value, name or text of the first tag of some below an element, in any namespace."""
    for found in inner_tags(element, tags):
        return (found.get("value") or found.get("name") or found.text or "").strip()
    return ""
