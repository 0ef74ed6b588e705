"""XML read with the place of every tag and attribute, so that numbers change and nothing else.

Files are edited as text that decodes from, and encodes to, the very same bytes: comments, quotes,
line ends, order and whitespace stay as they are.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from loopid.errors import RobotFileError

TOKEN = re.compile(
    r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>"
    r"|<!DOCTYPE(?:[^\"'\[>]|\"[^\"]*\"|'[^']*')*(?:\[.*?\]\s*)?>"
    r"|</(?P<closed>[^\s>]+)\s*>"
    r"|<(?P<opened>[^\s/>!?]+)(?P<rest>(?:[^\"'>]|\"[^\"]*\"|'[^']*')*)>",
    re.DOTALL,
)
ATTRIBUTE = re.compile(r"\s+([^\s=/>\"']+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
ENCODING = re.compile(rb"^<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._-]+)[\"']")
# Marks at the beginning of a file, the longer first; each stays in the text as a character.
MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
    (codecs.BOM_UTF8, "utf-8"),
)


@dataclass(frozen=True)
class Attribute:
    """Where an attribute is, with the space in front of it, and where its value is."""

    start: int
    end: int
    value: slice


@dataclass
class Tag:
    """An element: where its tag starts and what is inside begins, its attributes and children."""

    name: str
    start: int
    inside: int
    attributes: dict[str, Attribute]
    children: list[Tag] = field(default_factory=list)

    def find(self, name: str) -> Tag | None:
        """The first child of a name."""
        return next(self.find_all(name), None)

    def find_all(self, name: str) -> Iterator[Tag]:
        """The children of a name."""
        return (child for child in self.children if child.name == name)

    def all(self) -> Iterator[Tag]:
        """The element itself and all elements inside it."""
        yield self
        for child in self.children:
            yield from child.all()


@dataclass(frozen=True)
class Edit:
    """Text to be put in the place of a slice of the file's."""

    place: slice
    text: str


@dataclass(frozen=True)
class LocatedXml:
    """The text of a file, how its bytes encode it, and its root element."""

    text: str
    encoding: str
    root: Tag

    def value(self, tag: Tag, attribute: str) -> str | None:
        """Text of an attribute as it is written; None where there is none."""
        found = tag.attributes.get(attribute)
        return None if found is None else self.text[found.value]

    def replaced(self, tag: Tag, attribute: str, value: str) -> Edit:
        """A new value for an attribute, which is added to the tag where it is missing."""
        found = tag.attributes.get(attribute)
        if found is not None:
            return Edit(found.value, value)
        behind_name = tag.start + 1 + len(tag.name)
        return Edit(slice(behind_name, behind_name), f' {attribute}="{value}"')

    def renamed(self, tag: Tag, attribute: str, name: str, value: str) -> Edit:
        """Another attribute in the place of one, or added to the tag where there is none."""
        found = tag.attributes.get(attribute)
        if found is None:
            return self.replaced(tag, name, value)
        return Edit(slice(found.start, found.end), f' {name}="{value}"')

    def removed(self, tag: Tag, attribute: str) -> Edit:
        """An attribute taken out, with the space in front of it."""
        found = tag.attributes[attribute]
        return Edit(slice(found.start, found.end), "")

    def added(self, parent: Tag, element: str) -> Edit:
        """An element as the first inside another that is not empty, indented as its children."""
        space = re.match(r"\s*", self.text[parent.inside :])
        indent = space.group() if space is not None else ""
        return Edit(slice(parent.inside, parent.inside), indent + element)

    def edited(self, edits: Sequence[Edit]) -> bytes:
        """The file with all edits, which do not overlap."""
        parts, last = [], 0
        for edit in sorted(edits, key=lambda edit: edit.place.start):
            parts += [self.text[last : edit.place.start], edit.text]
            last = edit.place.stop
        return "".join([*parts, self.text[last:]]).encode(self.encoding)


def written(*numbers: float) -> str:
    """Numbers as the shortest text that is read as the very same numbers."""
    return " ".join(repr(float(number)) for number in numbers)


def locate(content: bytes) -> LocatedXml:
    """Find all tags in the content of a file, refused when it could not be written back."""
    marked = [encoding for mark, encoding in MARKS if content.startswith(mark)]
    declared = ENCODING.match(content)
    encoding = marked[0] if marked else declared[1].decode() if declared else "utf-8"
    try:
        text = content.decode(encoding)
        faithful = text.encode(encoding) == content
    except (LookupError, UnicodeError) as error:
        raise RobotFileError(f"its encoding cannot be read: {error}") from error
    if not faithful:
        raise RobotFileError(f"its encoding {encoding} cannot be written back unchanged")
    top = Tag("", 0, 0, {})
    path = [top]
    for token in TOKEN.finditer(text):
        if token["opened"] is not None:
            tag = Tag(token["opened"], token.start(), token.end(), _attributes(token))
            path[-1].children.append(tag)
            if not token["rest"].endswith("/"):
                path.append(tag)
        elif token["closed"] is not None and path.pop().name != token["closed"]:
            raise RobotFileError(f"</{token['closed']}> closes nothing")
    if len(top.children) != 1 or len(path) != 1:
        raise RobotFileError("its tags do not form one tree")
    return LocatedXml(text, encoding, top.children[0])


def _attributes(token: re.Match[str]) -> dict[str, Attribute]:
    first, found = token.start("rest"), {}
    for match in ATTRIBUTE.finditer(token["rest"]):
        group = 2 if match[2] is not None else 3
        value = slice(first + match.start(group), first + match.end(group))
        found[match[1]] = Attribute(first + match.start(), first + match.end(), value)
    return found
