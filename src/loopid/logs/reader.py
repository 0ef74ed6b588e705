"""What every format of a log can be asked for; one format a file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

from loopid.logs.mapping import LogMapping
from loopid.logs.table import Table


class LogReader(ABC):
    """A log of some format: one or more named streams, each a table.

    Parameters
    ----------
    path : Path
    mapping : LogMapping

    Attributes
    ----------
    format : str
        Its name in a mapping.
    choice : str or None
        The key of a mapping that chooses among the streams, which other formats do not have.
    ordered : bool
        Whether the columns of a stream stand in an order that says something.
    """

    format: ClassVar[str]
    choice: ClassVar[str | None] = None
    ordered: ClassVar[bool] = True

    def __init__(self, path: Path, mapping: LogMapping) -> None:
        self._path = path
        self._mapping = mapping

    @classmethod
    @abstractmethod
    def accepts(cls, path: Path) -> bool:
        """Whether a path looks like a log of this format."""

    @abstractmethod
    def columns(self) -> dict[str, tuple[str, ...]]:
        """Names of the columns of each stream.

        Raises
        ------
        LogError
            When the file is not of this format.
        """

    def together(self, stream: str, names: Sequence[str]) -> list[tuple[str, ...]]:
        """Columns of a stream in groups that share their rows; by default all do."""
        return [tuple(names)]

    @abstractmethod
    def read(self, stream: str, names: Sequence[str]) -> Iterator[Table]:
        """Some columns of a stream that share their rows, some rows at a time.

        Raises
        ------
        LogError
            When the file is not of this format.
        """
