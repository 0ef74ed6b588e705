"""Lines of a text file, packed or not, and where its cells are separated."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Generator
from pathlib import Path

from loopid.errors import LogError, MissingFileError

TEXT_ENDINGS = (".csv", ".txt", ".tsv")
OTHER_ENDINGS = (".npz", ".parquet", ".pq", ".h5", ".hdf5", ".bag", ".mcap", ".db3")
PACKED = ".gz"
# Of separators that split a header into equally many cells, the first is taken.
SEPARATORS: tuple[str | None, ...] = ("\t", ";", ",", None)
QUOTATION_MARKS = "\"'"


def is_text_name(path: Path) -> bool:
    """Whether a file is called like a table of text."""
    return path.name.lower().removesuffix(PACKED).endswith(TEXT_ENDINGS)


def stream_name(path: Path) -> str:
    """Name of the stream in a file: the file's name without its endings."""
    name = path.name
    for ending in (PACKED, *TEXT_ENDINGS, *OTHER_ENDINGS):
        if name.lower().endswith(ending):
            name = name[: -len(ending)]
    return name


def read_lines(path: Path) -> Generator[str]:
    """Lines without their ends; the last is empty when the file ends with a whole line.

    Raises
    ------
    MissingFileError, LogError
        When there is no such file, or it cannot be unpacked.
    """
    try:
        with path.open("rb") as packed, _text(packed) as lines:
            line = ""
            for line in lines:
                yield line.removesuffix("\n").removesuffix("\r")
            if not line or line.endswith("\n"):
                yield ""
    except FileNotFoundError as error:
        raise MissingFileError(f"there is no log {path}") from error
    except (OSError, EOFError, zlib.error) as error:
        raise LogError(f"{path} cannot be read: {error}") from error


def _text(packed: io.BufferedReader) -> io.TextIOWrapper:
    """Unpacked text; bytes that are no text garble their own row only."""
    is_packed = packed.peek(2).startswith(b"\x1f\x8b")
    content = gzip.GzipFile(fileobj=packed) if is_packed else packed
    return io.TextIOWrapper(content, encoding="utf-8-sig", errors="replace", newline="\n")


def separator_of(header: str) -> str | None:
    """What separates the cells of a header; None for any white space."""
    return max(SEPARATORS, key=lambda separator: len(header.strip().split(separator)))


def split_line(line: str, separator: str | None) -> list[str]:
    """The cells of a line, without quotation marks around them.

    Where commas do not separate, they are decimal points. White space around numbers stays.
    """
    line = line if separator == "," else line.replace(",", ".")
    cells = line.split(separator)
    if not any(mark in line for mark in QUOTATION_MARKS):
        return cells
    return [cell.strip().strip(QUOTATION_MARKS).strip() for cell in cells]


def is_number(cell: str) -> bool:
    """Whether a cell is a number, or empty."""
    try:
        float(cell)
    except ValueError:
        return cell.strip() == ""
    return True
