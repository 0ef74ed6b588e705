"""What can go wrong: one root exception and one subclass a failure."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Self

LONGEST_VALUE = 60  # columns of a value in a sentence


def one_line(text: str) -> str:
    """The text with escapes for what would break its line or its encoding, as in odd file names."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def counted(count: int, noun: str) -> str:
    """A number of things, as in "1 degree" and "2 degrees"."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def first_of(names: Sequence[str], most: int) -> str:
    """The first of some names, as in "hip, knee and 3 more"."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def short_name(name: str, longest: int) -> str:
    """A name on one line, its middle left out where it takes more columns."""
    from rich.cells import cell_len  # characters of some scripts are twice as wide

    line = one_line(name)
    width = cell_len(line)
    half = (longest - 1) * len(line) // max(2 * width, 1)
    return line if width <= longest else f"{line[:half]}…{line[len(line) - half :]}"


def shown(value: object) -> str:
    """A value in a sentence, of a long one both ends: a path ends with the name of its file."""
    return short_name(repr(value), LONGEST_VALUE)


def unknown_word(what: str, given: object, valid: Iterable[str], where: str = "") -> str:
    """Which word is unknown, what it likely was to be, and which words are valid."""
    known = (*valid,)
    there = f"choose among {', '.join(known)}" if known else "there is none"
    return f"unknown {what} {shown(given)}{where}{near(given, known)}: {there}"


def near(given: object, valid: Iterable[str]) -> str:
    """Which of the valid words a given one likely was to be; nothing where none is near."""
    known = {word.lower(): word for word in valid}
    found = get_close_matches(str(given).lower(), known, n=1)
    return f" (did you mean {known[found[0]]!r}?)" if found else ""


class LoopidError(Exception):
    """Root of every error that loopid raises on purpose: one sentence, and the facts in it.

    Attributes
    ----------
    facts : dict
        What programs may act on: the file, the argument or key, the value, the tolerance, the
        choices; numbers of what cannot be computed.

    Examples
    --------
    >>> import loopid
    >>> try:
    ...     loopid.load("six_bar.urdf")
    ... except loopid.LoopidError as error:
    ...     print(str(error)[:28])
    six_bar.urdf does not exist,
    """

    def __init__(self, message: object = "", **facts: Any) -> None:
        super().__init__(message)
        self.facts = facts

    def __str__(self) -> str:
        return one_line(str(self.args[0]) if self.args else "")

    @classmethod
    def unknown(
        cls, what: str, given: object, valid: Iterable[str], where: str = "", **facts: Any
    ) -> Self:
        """Say which word was given, and which are valid."""
        known = (*valid,)
        message = unknown_word(what, given, known, where)
        return cls(message, given=given, valid=known, **facts)

    @classmethod
    def require(cls, what: str, given: object, valid: Collection[str], where: str = "") -> None:
        """Refuse a word that is none of the valid ones."""
        if given not in valid:
            raise cls.unknown(what, given, valid, where)


class OptionError(LoopidError, ValueError):
    """An argument is not one of those that are valid, or requires what cannot be done."""


class MissingExtraError(LoopidError, ImportError):
    """An optional library is not installed."""


class FileError(LoopidError, OSError):
    """A file is not there, or cannot be written there."""


class RobotFileError(LoopidError, ValueError):
    """A robot description contradicts itself or physics."""


class MobilityError(LoopidError, ValueError):
    """The given coordinates are too few or too many for the motion."""


class AssemblyError(LoopidError, RuntimeError):
    """The loops cannot be closed for the given coordinates."""


class SingularityError(LoopidError, ArithmeticError):
    """The actuated coordinates lose control of the motion at a configuration."""


class DataError(LoopidError, ValueError):
    """Values have the wrong shape, are not finite, or physically impossible."""


class RankError(LoopidError, ArithmeticError):
    """A rank cannot be separated from round-off."""


class LogError(LoopidError, ValueError):
    """A log cannot be read, or does not match its declared format."""


@contextmanager
def optional(package: str, extra: str) -> Iterator[None]:
    """Name the package that cannot be imported inside, and the extra of loopid that brings it."""
    try:
        yield
    except ImportError as error:
        message = f"{package} is not installed: pip install 'loopid[{extra}]' brings it"
        raise MissingExtraError(message, package=package, extra=extra) from error


@contextmanager
def naming(what: str | Path) -> Iterator[None]:
    """Name a file or an element in front of what is refused inside."""
    try:
        yield
    except (RobotFileError, OptionError) as error:
        place = {"file": str(what)} if isinstance(what, Path) else {"element": what}
        raise type(error)(f"{what}: {error}", **(place | error.facts)) from error


class ModelWarning(UserWarning):
    """A model leaves out what a file says, or a robot file is odd: inertias, motors, reference."""


class DataWarning(UserWarning):
    """Data are left out, look wrong, or determine a parameter badly."""


class AccuracyWarning(UserWarning):
    """A result rests on more digits than there are: rounded files, poses near singularities."""


def warn(message: str, category: type[Warning]) -> None:
    """Warn at the line that called loopid, however deep inside it the reason was found."""
    level, frame = 2, sys._getframe(1)
    # Between them pydantic checks arguments, and contextlib enters contexts.
    inside = ("loopid.", "pydantic.", "contextlib")
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith(inside):
        level, frame = level + 1, frame.f_back
    warnings.warn(one_line(message), category, stacklevel=level)
