"""Logs of text: one table in one file, or a folder with one file a stream."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from loopid.errors import LogError
from loopid.logs.reader import LogReader
from loopid.logs.table import Table
from loopid.logs.text_lines import is_text_name, stream_name
from loopid.logs.text_table import read_header, read_tables


class TextReader(LogReader):
    """One table: .csv, .txt or .tsv, packed with gzip or not."""

    format = "csv"

    @classmethod
    def accepts(cls, path: Path) -> bool:
        return is_text_name(path) and not path.is_dir()

    def columns(self) -> dict[str, tuple[str, ...]]:
        return {stream_name(self._path): read_header(self._path).names}

    def read(self, stream: str, names: Sequence[str]) -> Iterator[Table]:
        return read_tables(self._path, names)


class FolderReader(LogReader):
    """A folder with one table a stream, each with time stamps of its own."""

    format = "folder"

    @classmethod
    def accepts(cls, path: Path) -> bool:
        return path.is_dir()

    def columns(self) -> dict[str, tuple[str, ...]]:
        return {stream: _names(file) for stream, file in _files(self._path).items()}

    def read(self, stream: str, names: Sequence[str]) -> Iterator[Table]:
        return read_tables(_files(self._path)[stream], names)


def _files(folder: Path) -> dict[str, Path]:
    files = {stream_name(file): file for file in sorted(folder.glob("*")) if is_text_name(file)}
    if not files:
        raise LogError(f"{folder} holds no streams: files that end in .txt, .csv, .tsv or .gz")
    return files


def _names(file: Path) -> tuple[str, ...]:
    """Its columns; none when it is no table, which matters only if its columns are needed."""
    try:
        return read_header(file).names
    except LogError:
        return ()
