"""Tables of text: a header, then one sample a line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from loopid.errors import LogError
from loopid.logs.table import Table
from loopid.logs.text_lines import is_number, read_lines, separator_of, split_line

COMMENT = "#"


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


def read_header(path: Path) -> Header:
    """Names of the columns of a text file."""
    return _header(path, read_lines(path))


def read_table(path: Path, names: Sequence[str]) -> Table:
    """Some columns of a text file, as text.

    Raises
    ------
    MissingFileError, LogError
        When it is not there, or no table.
    """
    lines = read_lines(path)
    header = _header(path, lines)
    cut_off = len(lines) if lines[-1].strip() else None
    body = [
        (row, split_line(line, header.separator))
        for row, line in enumerate(lines[header.lines : -1], header.lines + 1)
        if line.strip()
    ]
    width = len(header.names)
    whole = {row: cells for row, cells in body if len(cells) == width}
    if not whole:
        raise LogError(f"{path} has no rows of {width} cells below its header")
    # Objects, lest one long cell make all the others as long.
    columns = dict(zip(header.names, zip(*whole.values(), strict=True), strict=True))
    return Table(
        source=str(path),
        columns={name: np.array(columns[name], dtype=object) for name in names},
        rows=np.array(list(whole), dtype=np.int64),
        garbled=np.array([row for row, _ in body if row not in whole], dtype=np.int64),
        cut_off=cut_off,
    )


def _header(path: Path, lines: list[str]) -> Header:
    """The first line that is no comment or, above bare numbers, the last comment."""
    filled = [k for k, line in enumerate(lines) if line.strip()]
    if not filled:
        raise LogError(f"{path} is empty")
    comments = [k for k in filled if lines[k].startswith(COMMENT)]
    at = next((k for k in filled if k not in comments), None)
    if at is None or _is_sample(lines[at]):
        above = [k for k in comments if at is None or k < at]
        if not above:
            raise LogError(
                f"{path} has no header: row {filled[0] + 1} holds numbers, {lines[filled[0]]!r:.60}"
            )
        at = above[-1]
    text = lines[at].lstrip(COMMENT).strip()
    if not text.replace("\t", " ").isprintable():
        raise LogError(f"{path} is no text: its first row is {text!r:.60}")
    separator = separator_of(text)
    return Header(_distinct(path, split_line(text, separator)), separator, at + 1)


def _is_sample(line: str) -> bool:
    cells = split_line(line, separator_of(line))
    return all(is_number(cell) for cell in cells) and any(cells)


def _distinct(path: Path, names: list[str]) -> tuple[str, ...]:
    repeated = sorted({name for name in names if name and names.count(name) > 1})
    if repeated:
        raise LogError(f"{path}: its header names column {repeated[0]!r} more than once")
    return tuple(names)
