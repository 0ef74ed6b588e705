"""YAML files, checked against a form of what they may say."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from pydantic import BaseModel
from ruamel.yaml import YAML
from ruamel.yaml.constructor import DuplicateKeyError
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent, ScalarEvent
from ruamel.yaml.nodes import MappingNode, SequenceNode
from ruamel.yaml.parser import Parser
from ruamel.yaml.representer import SafeRepresenter

from loopid.border import validated
from loopid.errors import FileError, LoopidError, RobotFileError, shown
from loopid.files import why_no_file

ENDINGS = (".yaml", ".yml")
# Far more than files that people write have: a few KB of YAML can ask for all the memory, and the
# parser takes seconds for 100 KB.
MOST_BYTES = 500_000
MOST_DEPTH = 50
MOST_ANCHORS = 100  # and aliases
# YAML takes 1_6 and 0x10 for 16.
ODD_NUMBER = re.compile(r"[-+]?([0-9.]+_[0-9_.]*([eE][-+]?[0-9_]+)?|0[box][0-9a-fA-F_]+)")
Content = TypeVar("Content", bound=BaseModel)


def read_yaml(
    path: Path, model: type[Content], failure: type[LoopidError] = RobotFileError
) -> Content:
    """Read a YAML file of keys and values as a model; an empty file leaves all keys out.

    It is no larger than it seems, and its texts are printable and on one line.
    """
    problem = why_no_file(path)
    if problem:
        kind = FileError if problem == "does not exist" else failure
        raise kind(f"{path} {problem}")
    try:
        with path.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise _BoundError(f"it is longer than the {MOST_BYTES / 1e6:g} MB that are read")
        yaml = YAML(typ="safe", pure=True)
        yaml.Parser = _BoundedParser
        text = data.decode("utf-8")
        content = yaml.load(io.StringIO(text))
    except _BoundError as error:
        raise failure(f"{path}: {error}") from error
    except DuplicateKeyError as error:
        raise failure(f"{path}: {_repetition(text, error)}") from error
    except OSError as error:
        raise failure(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise failure(f"{path} is no text in UTF-8 (line {line}): save it in UTF-8") from error
    except (YAMLError, ValueError, ArithmeticError, LookupError) as error:
        raise failure(f"{path} is not YAML: {_yaml_problem(error)}") from error
    content = {} if content is None else content
    return validated(model, content, path, failure, partial(line_of, path))


def line_of(path: Path, keys: Sequence[Any]) -> int | None:
    """The line in which what a path of keys leads to begins, in a file that was read before."""
    lines = dict[tuple[str, ...], int]()
    for word in _words(YAML(typ="safe", pure=True).compose(path.read_text("utf-8"))):
        lines.setdefault(tuple(map(str, word.keys)), word.line)
    known = (tuple(map(str, keys[:k])) for k in range(len(keys), 0, -1))
    return next((lines[part] for part in known if part in lines), None)


@contextmanager
def placing(path: Path, but: Sequence[str] = ()) -> Iterator[None]:
    """Name the line and the keys in a YAML file of what is refused inside.

    An error gives the ``keys`` that lead there, or as ``given`` a word that stands there once. What
    is below the keys ``but`` was given otherwise.
    """
    try:
        yield
    except LoopidError as error:
        facts = error.facts
        word, keys, line = facts.get("given"), facts.get("keys"), None
        if path.suffix not in ENDINGS or "line" in facts or not path.is_file():
            raise
        if keys is None and isinstance(word, str):
            node = YAML(typ="safe", pure=True).compose(path.read_text("utf-8"))
            found = [each.keys for each in _words(node) if each.text == word]
            keys = found[0] if len(found) == 1 else None  # of several it may be another one
        if not keys or keys[0] in but or (line := line_of(path, keys)) is None:
            raise
        key, said = ".".join(map(str, keys)), str(error).removeprefix(f"{path}: ")
        for each in keys:  # which the sentence need not begin with
            said = said.removeprefix(f"{each}: ")
        more = {"key": key, **facts, "line": line}
        raise type(error)(f"{path}: line {line}, {key}: {said}", **more) from error


class _Word(NamedTuple):
    """A word of a YAML file, or a section in a list without one, and the keys that lead to it."""

    text: str | None
    keys: tuple[str | int, ...]
    line: int
    is_key: bool


def _words(node: Any, keys: tuple[str | int, ...] = ()) -> Iterator[_Word]:
    if isinstance(node, MappingNode):
        for name, value in node.value:
            own = (*keys, str(name.value))
            yield _Word(str(name.value), own, name.start_mark.line + 1, is_key=True)
            yield from _words(value, own)
    elif isinstance(node, SequenceNode):
        for k, each in enumerate(node.value):
            yield _Word(None, (*keys, k), each.start_mark.line + 1, is_key=False)
            yield from _words(each, (*keys, k))
    elif node is not None:
        yield _Word(node.value, keys, node.start_mark.line + 1, is_key=False)


def _repetition(text: str, error: DuplicateKeyError) -> str:
    """Which key stands in two lines; of keys that are written in two ways where the second is."""
    lines = dict[tuple[str | int, ...], int]()
    for word in _words(YAML(typ="safe", pure=True).compose(text)):
        if word.is_key and word.keys in lines:
            return f"line {word.line}: key {shown(word.text)} stands in line {lines[word.keys]} too"
        if word.is_key:
            lines[word.keys] = word.line
    line = error.problem_mark.line + 1
    return f"line {line}: a key stands there that its section has already, written otherwise"


def yaml_text(content: Mapping[str, Any]) -> str:
    """Keys and values as they stand in a file."""
    stream = io.StringIO()
    yaml_writer().dump(content, stream)
    return stream.getvalue()


def yaml_writer() -> YAML:
    """Writes keys in their order, and short lists on one line."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Representer = _Representer
    yaml.allow_unicode = True
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.default_flow_style = None
    return yaml


class _Representer(SafeRepresenter):
    """Quotes texts with ":" or "?", which ruamel.yaml cannot read everywhere without."""

    def represent_text(self, text: str) -> Any:
        style = '"' if set(text) & set(":?") else None
        return self.represent_scalar("tag:yaml.org,2002:str", text, style)


_Representer.add_representer(str, _Representer.represent_text)


class _BoundError(Exception):
    """What a YAML file has too much of, or what loopid does not read."""


class _BoundedParser(Parser):
    """Parser that refuses, before anything is made of them, files that are more than they seem."""

    def __init__(self, loader: Any) -> None:
        super().__init__(loader)
        self.open: list[bool] = []  # for each collection, whether it is in one with an anchor
        self.anchors = 0

    def get_event(self) -> Any:
        event = super().get_event()
        line, named = event.start_mark.line + 1, any(self.open[-1:])
        anchor = getattr(event, "anchor", None)
        self.anchors += anchor is not None
        if self.anchors > MOST_ANCHORS:
            raise _BoundError(
                f"line {line} has more than the {MOST_ANCHORS} anchors (&) and aliases (*) read"
            )
        if isinstance(event, AliasEvent):
            if named:  # a few would stand for any number of values
                raise _BoundError(
                    f"*{anchor} in line {line} is in what has an anchor (&) itself: write it out"
                )
        elif getattr(event, "tag", None) is not None:
            raise _BoundError(f"tag {shown(event.tag)} in line {line} is not read: remove it")
        elif isinstance(event, ScalarEvent):
            self._require_plain(event, line)
        elif isinstance(event, CollectionStartEvent):
            if len(self.open) == MOST_DEPTH:
                raise _BoundError(f"line {line} is nested too deeply, in more than {MOST_DEPTH}")
            self.open.append(named or anchor is not None)
        elif isinstance(event, CollectionEndEvent):
            self.open.pop()
        return event

    def _require_plain(self, event: ScalarEvent, line: int) -> None:
        """Refuse a scalar that is a number by accident, or breaks a line."""
        text = event.value
        if not text.isprintable():
            raise _BoundError(
                f"texts must be printable and on one line, not {shown(text)} in line {line}"
            )
        if event.implicit[0] and ODD_NUMBER.fullmatch(text):
            what = "a number with _" if "_" in text else "a number with 0x, 0o or 0b"
            raise _BoundError(f"{shown(text)} in line {line} is {what}: quote it if not")


def _yaml_problem(error: Exception) -> str:
    if isinstance(error, MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        return f"{error.problem} (line {mark.line + 1}, column {mark.column + 1})"
    return " ".join(str(error).split())
