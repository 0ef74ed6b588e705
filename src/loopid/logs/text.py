"""Logs of text: one table a file, or a folder of them; packed with gzip or not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from functools import cached_property
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from loopid.arguments import number
from loopid.errors import LogError
from loopid.files import text_blocks, why_no_file
from loopid.logs.formats import AROUND_CELLS, PACKED, LogFormat, Table, stream_name

ENDINGS = (".csv", ".txt", ".tsv")
COMMENT = "#"
# Of separators that split a header into equally many cells, the first is taken; None is any space.
SEPARATORS = ("\t", ";", ",", None)
NO_NUMBERS = ("", "nan", "+nan", "-nan")


class TextFormat(LogFormat):
    """One table of text: a header if any, then one sample a line."""

    endings = (*ENDINGS, *(f"{ending}{PACKED}" for ending in ENDINGS))

    @cached_property
    def _files(self) -> dict[str, Path]:
        return {stream_name(self.path): self.path}

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {stream: read_header(file).names for stream, file in self._files.items()}

    def source(self, stream: str) -> str:
        return str(self._files[stream])

    def tables(self, stream: str, names: Sequence[str]) -> Sequence[Table]:
        return [read_table(self._files[stream], names)]


class FolderFormat(TextFormat):
    """A folder with one table of text a stream, each with time stamps of its own."""

    @classmethod
    def accepts(cls, path: Path) -> bool:
        return path.is_dir()

    @cached_property
    def _files(self) -> dict[str, Path]:
        named = (f for f in sorted(self.path.glob("*")) if f.name.lower().endswith(self.endings))
        files = [file for file in named if not file.is_dir()]
        for file in files:
            if reason := why_no_file(file):
                raise LogError(f"{file} {reason}", file=file)
        if not files:
            raise LogError(
                f"{self.path} holds no streams: files that end in .txt, .csv, .tsv or .gz",
                file=self.path,
                valid=self.endings,
            )
        return {stream_name(file): file for file in files}

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        found: dict[str, tuple[str, ...]] = dict.fromkeys(self._files, ())
        for stream, file in self._files.items():
            with suppress(LogError):  # matters only if its columns are needed
                found[stream] = read_header(file).names
        return found


def read_table(path: Path, names: Sequence[str]) -> Table:
    """Some columns as text.

    Polars' reader of CSV would fill short rows, cut long ones, pass over blank ones and number
    none: here it splits lines one by one.
    """
    import polars

    header, read, cut_off = read_header(path), 0, None
    separator, width = header.separator, len(header.names)
    places = {name: header.names.index(name) for name in names}
    tables, rows, garbled = [], [], []
    with closing(text_blocks(path)) as blocks:
        for block in blocks:
            text, whole = block.decode("utf-8", "replace"), block.endswith(b"\n")
            lines = polars.Series(text.removeprefix("\ufeff").removesuffix("\n").split("\n"))
            numbers = np.arange(read + 1, read + len(lines) + 1)
            read += len(lines)
            if separator != ",":
                lines = lines.str.replace_all(",", ".", literal=True)  # decimal commas
            filled = lines.str.contains(r"\S").to_numpy() & (numbers > header.lines)
            cut_off = None if whole or not filled[-1] else int(numbers[-1])
            filled[-1] &= whole
            if separator is None:
                cells = lines.str.extract_all(r"\S+")
            else:
                cells = lines.str.split(separator)
            fine = filled & (cells.list.len() == width).to_numpy()
            cells = cells.filter(fine).list
            tables.append(polars.DataFrame({name: cells.get(k) for name, k in places.items()}))
            rows.append(numbers[fine])
            garbled.append(numbers[filled & ~fine])
    table = Table(polars.concat(tables), np.concatenate(rows), np.concatenate(garbled), cut_off)
    if not len(table.rows):
        raise LogError(f"{path} has no rows of {width} cells below its header", file=path)
    return table


# ---- headers ----------------------------------------------------------------------------------


class Header(NamedTuple):
    """Names of the columns, what separates cells, and lines before the first sample."""

    names: tuple[str, ...]
    separator: str | None
    lines: int


def read_header(path: Path) -> Header:
    """The first line that is no comment or, above bare numbers, the last comment.

    A comment with another number of cells names no columns: then they are called 1, 2, 3.
    """
    row, text, comment = _first_line(path)
    separator = _separator(text)
    names = text.split(separator)
    if _are_numbers(text, separator):
        row, named = row - 1, comment.split(_separator(comment))
        names = named if len(named) == len(names) else [str(k + 1) for k in range(len(names))]
    names = [name.strip(AROUND_CELLS) for name in names]
    repeated = sorted(name for name, count in Counter(names).items() if name and count > 1)
    if repeated:
        raise LogError(
            f"{path}: its header names column {repeated[0]!r} more than once",
            file=path,
            column=repeated[0],
        )
    return Header(tuple(names), separator, row)


def _first_line(path: Path) -> tuple[int, str, str]:
    """Number and text of the first line that is no comment, and the last comment above it."""
    comment = ""
    with closing(text_blocks(path)) as blocks:
        for row, data in enumerate(chain.from_iterable(map(BytesIO, blocks)), 1):
            line = data.decode("utf-8", "replace").rstrip("\r\n")
            line = line.removeprefix("\ufeff") if row == 1 else line
            if not line.replace("\t", " ").isprintable():
                raise LogError(f"{path} is no text: row {row} is {line!r:.60}", file=path, row=row)
            if line.startswith(COMMENT):
                comment = line.lstrip(COMMENT).strip()
            elif line.strip():
                return row, line, comment
    raise LogError(f"{path} is empty{', but for comments' if comment else ''}", file=path)


def _separator(line: str) -> str | None:
    """What splits a line into most cells; into numbers, where one does."""
    line = line.strip()
    numbers = [one for one in SEPARATORS if _are_numbers(line, one)]
    return max(numbers or SEPARATORS, key=lambda separator: len(line.split(separator)))


def _are_numbers(line: str, separator: str | None) -> bool:
    """Whether all cells of a line are numbers or empty."""
    line = line if separator == "," else line.replace(",", ".")
    cells = [cell.strip(AROUND_CELLS) for cell in line.split(separator)]
    return any(cells) and all(
        cell.casefold() in NO_NUMBERS or not np.isnan(number(cell)) for cell in cells
    )
