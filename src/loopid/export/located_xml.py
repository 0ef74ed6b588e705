"""XML in which numbers change and nothing else.

Comments, quotes, line ends, order and whitespace stay as they are. A file is text with a character
a byte, whatever its encoding says: tags and numbers are ASCII in all that robot files have.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
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
BYTES = "latin-1"  # the encoding with a character a byte


@dataclass
class Tag:
    """An element: where its tag starts and what is inside begins, its attributes and children.

    Of an attribute there is its match, which begins with the space in front of it.
    """

    name: str
    start: int
    inside: int
    attributes: dict[str, re.Match[str]]
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

    def value(self, attribute: str) -> str | None:
        """Text of an attribute as it is written, in UTF-8; None where there is none."""
        found = self.attributes.get(attribute)
        if found is None:
            return None
        return found[found.lastindex or 0].encode(BYTES).decode("utf-8", "replace")


class LocatedXml:
    """The content of a file with its root element; refused when its tags do not form one tree.

    Edits, which must not overlap, are collected.
    """

    def __init__(self, content: bytes) -> None:
        self.text = content.decode(BYTES)
        self._edits: list[tuple[int, int, str]] = []
        top = Tag("", 0, 0, {})
        path = [top]
        for token in TOKEN.finditer(self.text):
            if token["opened"] is not None:
                found = ATTRIBUTE.finditer(self.text, *token.span("rest"))
                attributes = {match[1]: match for match in found}
                tag = Tag(token["opened"], token.start(), token.end(), attributes)
                path[-1].children.append(tag)
                if not token["rest"].endswith("/"):
                    path.append(tag)
            elif token["closed"] is not None and path.pop().name != token["closed"]:
                raise RobotFileError(f"</{token['closed']}> closes nothing")
        if len(top.children) != 1 or len(path) != 1:
            raise RobotFileError("its tags do not form one tree")
        self.root = top.children[0]

    def set(self, tag: Tag, attribute: str, value: str, instead_of: str = "") -> None:
        """Give an attribute a value; it may take the place of another, or is added."""
        written, found = f' {attribute}="{value}"', tag.attributes.get(instead_of)
        own = tag.attributes.get(attribute)
        if found is not None:
            self._edits.append((*found.span(), written))
        elif own is not None:
            self._edits.append((*own.span(own.lastindex or 0), value))
        else:
            behind_name = tag.start + 1 + len(tag.name)
            self._edits.append((behind_name, behind_name, written))

    def remove(self, tag: Tag, attribute: str) -> None:
        """Take an attribute out, with the space in front of it."""
        self._edits.append((*tag.attributes[attribute].span(), ""))

    def add(self, parent: Tag, element: str) -> None:
        """Add an element as the first one inside another, indented as its children are."""
        inside = self.text[parent.inside :]
        indent = inside[: len(inside) - len(inside.lstrip())]
        self._edits.append((parent.inside, parent.inside, indent + element))

    def content(self) -> bytes:
        """The file with all edits."""
        parts, last = [], 0
        for start, end, text in sorted(self._edits):
            parts += [self.text[last:start], text]
            last = end
        return "".join([*parts, self.text[last:]]).encode(BYTES)


def written(*numbers: float) -> str:
    """Numbers as the shortest text that is read as the very same numbers."""
    return " ".join(repr(float(number)) for number in numbers)
