"""Tables of text: a header, then one sample a line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from loopid.errors import LogError
from loopid.logs.table import Table
from loopid.logs.text_lines import is_number, read_lines, separator_of, split_line
from loopid.scratch import BLOCK_ROWS

COMMENT = "#"
Numbered = tuple[int, str]


@dataclass(frozen=True)
class Header:
    """Names of the columns, and how the lines below are split.

    Attributes
    ----------
    names : tuple of str
    separator : str or None
        None for any white space.
    lines : int
        How many lines come before the first sample.
    """

    names: tuple[str, ...]
    separator: str | None
    lines: int


def read_tables(path: Path, names: Sequence[str]) -> Iterator[Table]:
    """Some columns of a text file, as text, block by block.

    Raises
    ------
    MissingFileError, LogError
        When it is not there, or no table.
    """
    header, found = read_header(path), 0
    last: Numbered = (0, "")
    with closing(read_lines(path)) as lines:
        numbered = islice(enumerate(lines, 1), header.lines, None)

        def whole_lines() -> Iterator[Numbered]:
            nonlocal last
            for line, last in pairwise(numbered):  # noqa: B007
                yield line

        body = whole_lines()
        while block := list(islice(body, BLOCK_ROWS)):
            table = _table(path, header, names, block)
            found += len(table.rows)
            yield table
    if not found:
        raise LogError(f"{path} has no rows of {len(header.names)} cells below its header")
    if last[1].strip():
        yield _table(path, header, names, [], cut_off=last[0])


def _table(
    path: Path,
    header: Header,
    names: Sequence[str],
    lines: Sequence[Numbered],
    cut_off: int | None = None,
) -> Table:
    split = [(row, split_line(line, header.separator)) for row, line in lines if line.strip()]
    width = len(header.names)
    whole = [(row, cells) for row, cells in split if len(cells) == width]
    at = [(name, header.names.index(name)) for name in names]
    # Objects, lest one long cell make all the others as long.
    return Table(
        source=str(path),
        columns={k: np.array([cells[j] for _, cells in whole], dtype=object) for k, j in at},
        rows=np.array([row for row, _ in whole], dtype=np.int64),
        garbled=np.array([row for row, cells in split if len(cells) != width], dtype=np.int64),
        cut_off=cut_off,
    )


def read_header(path: Path) -> Header:
    """The first line that is no comment or, above bare numbers, the last comment."""
    filled: list[Numbered] = []
    comment: Numbered | None = None
    with closing(read_lines(path)) as lines:
        for row, line in enumerate(lines, 1):
            if not line.strip():
                continue
            filled = filled or [(row, line)]
            if not line.startswith(COMMENT):
                if not _is_sample(line):
                    return _header(path, row, line)
                break
            comment = row, line
    if comment is not None:
        return _header(path, *comment)
    if not filled:
        raise LogError(f"{path} is empty")
    row, line = filled[0]
    raise LogError(f"{path} has no header: row {row} holds numbers, {line!r:.60}")


def _header(path: Path, row: int, line: str) -> Header:
    text = line.lstrip(COMMENT).strip()
    if not text.replace("\t", " ").isprintable():
        raise LogError(f"{path} is no text: its first row is {text!r:.60}")
    separator = separator_of(text)
    names = [name.strip() for name in split_line(text, separator)]
    return Header(_distinct(path, names), separator, row)


def _is_sample(line: str) -> bool:
    cells = split_line(line, separator_of(line))
    return all(is_number(cell) for cell in cells) and any(cell.strip() for cell in cells)


def _distinct(path: Path, names: list[str]) -> tuple[str, ...]:
    repeated = sorted({name for name in names if name and names.count(name) > 1})
    if repeated:
        raise LogError(f"{path}: its header names column {repeated[0]!r} more than once")
    return tuple(names)
