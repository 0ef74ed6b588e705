"""What every format of a log can be asked for; one format a file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path

from loopid.logs.table import Table


class LogReader(ABC):
    """A format of logs: one or more named streams, each a table.

    Attributes
    ----------
    format : str
        Its name in a mapping.
    """

    format: str

    @abstractmethod
    def accepts(self, path: Path) -> bool:
        """Whether a path looks like a log of this format."""

    @abstractmethod
    def columns(self, path: Path) -> dict[str, tuple[str, ...]]:
        """Names of the columns of each stream.

        Raises
        ------
        LogError
            When the file is not of this format.
        """

    @abstractmethod
    def read(self, path: Path, stream: str, names: Sequence[str]) -> Iterator[Table]:
        """Some columns of a stream, some rows at a time.

        Raises
        ------
        LogError
            When the file is not of this format.
        """
