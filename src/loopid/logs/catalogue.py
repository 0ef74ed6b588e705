"""The columns that a log has, found by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from loopid.errors import LogError

MOST_LISTED = 30


class Place(NamedTuple):
    """A column of a stream."""

    stream: str
    column: str

    def __str__(self) -> str:
        return f"{self.stream}:{self.column}"


@dataclass(frozen=True)
class Catalogue:
    """All streams of a log with the names of their columns.

    Attributes
    ----------
    source : str
        The log, for messages.
    streams : mapping
    choice : str or None
        The key of a mapping that chooses a stream, if there is one.
    ordered : bool
        Whether the columns of a stream stand in an order that says something.
    """

    source: str
    streams: Mapping[str, tuple[str, ...]]
    choice: str | None = None
    ordered: bool = True

    def find(self, reference: str) -> Place:
        """The column called ``column`` or ``stream:column``.

        Raises
        ------
        LogError
            When there is none, or several.
        """
        found = [place for place in self._places() if reference in (place.column, str(place))]
        if not found:
            raise LogError(f"{self.source} has no column {reference!r}: {self.choices()}")
        if len(found) > 1:
            several = ", ".join(map(str, found))
            raise LogError(f"{self.source} has several columns {reference!r}: write {several}")
        return found[0]

    def matching(self, names: Iterable[str]) -> list[Place]:
        """Columns with one of the names, whatever their case."""
        wanted = {name.casefold() for name in names}
        return [place for place in self._places() if place.column.casefold() in wanted]

    def of_stream(self, stream: str) -> tuple[str, ...]:
        """Columns of a stream.

        Raises
        ------
        LogError
            When there is no such stream.
        """
        if stream not in self.streams:
            valid = ", ".join(self.streams)
            raise LogError(f"{self.source} has no stream {stream!r}: choose among {valid}")
        return self.streams[stream]

    def advice(self) -> str:
        """How to choose among columns that are called alike, for messages."""
        also = f", or a {self.choice}," if self.choice is not None and len(self.streams) > 1 else ""
        return f"name one{also} in a mapping"

    def choices(self) -> str:
        """The columns, for messages."""
        several = len(self.streams) > 1
        names = [str(place) if several else place.column for place in self._places()]
        more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
        listed = ", ".join(f"{name:.60}" for name in names[:MOST_LISTED])
        unread = [stream for stream, columns in self.streams.items() if not columns]
        ends = f" (no header in {', '.join(unread)})" if unread else ""
        return f"choose among {listed}{more}{ends}"

    def _places(self) -> list[Place]:
        return [Place(stream, column) for stream, names in self.streams.items() for column in names]
