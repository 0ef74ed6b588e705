"""Logs as tables of text, and folders of them: what separates cells, and which line names them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from contextlib import closing, nullcontext, suppress
from functools import cached_property
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import polars

from loopid.arguments import number
from loopid.errors import LogError, shown
from loopid.files import LONGEST_LINE, text_blocks, why_no_file
from loopid.logs.signals import is_unit
from loopid.logs.table import (
    AROUND_CELLS,
    CLOCK,
    LOOKED_AT,
    PACKED,
    LogFormat,
    Table,
    floats,
    stream_name,
)

ENDINGS = (".csv", ".txt", ".tsv")
LEAST_LINES = 4  # that decide how a text is written, where they are long
COMMENTS = ("#", "%")
# Of separators that do equally well, the first is taken; None is any space.
SEPARATORS = ("\t", ";", ",", None)
QUOTED = r'"(?:[^"]|"")*"'
NO_NUMBERS = ("", "nan", "+nan", "-nan")
AROUND_UNITS = "[](){} "
NO_UNITS = ("", "-", "1")  # of columns without one, in a line of units
# Commas of thousands look like decimal ones in a cell between quotes; of these neither is read.
THOUSANDS = r"^[+-]?[1-9]\d{0,2}(?:,\d{3})+$"
Item = TypeVar("Item", bound=Hashable)


class TextFormat(LogFormat):
    """Tables of text: a header if any, then one sample a line; of a folder a stream a file."""

    endings = (*ENDINGS, *(f"{ending}{PACKED}" for ending in ENDINGS))

    @classmethod
    def accepts(cls, path: Path) -> bool:
        return path.is_dir() or super().accepts(path)

    @cached_property
    def _files(self) -> dict[str, Path]:
        files = [self.path]
        if self.path.is_dir():
            files = [*filter(super().accepts, sorted(self.path.glob("*")))]
        for file in files:
            if reason := why_no_file(file):
                raise LogError(f"{file} {reason}", file=file)
        if not files:
            said = "holds no streams: files that end in .txt, .csv, .tsv or .gz"
            raise self.refused(said, valid=self.endings)
        return {stream_name(file): file for file in files}

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        found: dict[str, tuple[str, ...]] = dict.fromkeys(self._files, ())
        for stream, file in self._files.items():
            # In a folder it matters only if its columns are needed.
            with suppress(LogError) if self.path.is_dir() else nullcontext():
                found[stream] = read_header(file).names
        return found

    def source(self, stream: str) -> str:
        return str(self._files[stream])

    def tables(self, stream: str, times: Sequence[str], values: Sequence[str]) -> Sequence[Table]:
        return [_read_table(self._files[stream], times, values)]


def _read_table(path: Path, times: Sequence[str], values: Sequence[str]) -> Table:
    """Times as text, and numbers; Polars' reader of CSV would number no rows, and fill or cut."""
    header, read, cut_off = read_header(path), 0, None
    width = len(header.names)
    tables, rows, garbled = [], [], []
    with closing(text_blocks(path)) as blocks:
        for block in blocks:
            text, whole = _decoded(block), block.endswith(b"\n")
            lines = polars.Series(text.removeprefix("\ufeff").removesuffix("\n").split("\n"))
            row = np.arange(read + 1, read + len(lines) + 1)
            read += len(lines)
            filled = lines.str.contains(r"\S").to_numpy() & (row > header.lines)
            cut_off = None if whole or not filled[-1] else int(row[-1])
            filled[-1] &= whole
            cells = _split(lines, header.separator, quoted='"' in text)
            fine = filled & (cells.list.len() == width).to_numpy()
            cells = cells.filter(fine).list
            columns = {name: cells.get(header.names.index(name)) for name in (*times, *values)}
            numbers = {name: floats(columns[name]) for name in values}
            tables.append(polars.DataFrame(columns | numbers))
            rows.append(row[fine])
            garbled.append(row[filled & ~fine])
    table = Table(polars.concat(tables), np.concatenate(rows), np.concatenate(garbled), cut_off)
    if not len(table.rows):
        raise LogError(
            f"{path} has no rows of {width} cells below row {header.lines}, as its header has: "
            "decimal commas, or names with a separator that are not in quotes?",
            file=path,
        )
    return table


def _decoded(data: bytes) -> str:
    """Text in UTF-8, or else in the code page of Windows, with all its spaces alike."""
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        text = data.decode("cp1252", "replace")
    return text.replace("\xa0", " ").replace("\u202f", " ")


def _split(lines: polars.Series, separator: str | None, *, quoted: bool) -> polars.Series:
    """Cells of lines, with decimal points; what is between quotes is in one cell."""
    if not quoted:
        if separator != ",":
            lines = lines.str.replace_all(",", ".", literal=True)
        return lines.str.extract_all(r"\S+") if separator is None else lines.str.split(separator)
    cells = ((separator or "") + lines).str.extract_all(_cell(separator))
    own = polars.element().str.strip_prefix(separator or "").str.strip_chars(AROUND_CELLS)
    points = own.str.replace_all(",", ".", literal=True)
    thousands = own.str.contains(THOUSANDS) if separator == "," else polars.lit(value=False)
    return cells.list.eval(polars.when(thousands).then(own).otherwise(points))


def _cell(separator: str | None) -> str:
    """Pattern of a cell with the separator before it, so that none is empty."""
    if separator is None:
        return rf"{QUOTED}|\S+"
    return rf"{separator} *(?:{QUOTED}[^{separator}]*|[^{separator}]*)"


# ---- the header -------------------------------------------------------------------------------


class Header(NamedTuple):
    """Names of the columns, what separates cells, and lines before the first sample."""

    names: tuple[str, ...]
    separator: str | None
    lines: int


class Line(NamedTuple):
    """A line that is not blank."""

    row: int
    text: str

    def cells(self, separator: str | None) -> list[str]:
        """What is between separators that stand outside of quotes."""
        found = re.findall(_cell(separator), (separator or "") + self.text)
        cells = [cell.removeprefix(separator or "").strip() for cell in found]
        # Between quotes two stand for one.
        return [
            c[1:-1].replace('""', '"').strip() if re.fullmatch(QUOTED, c) else c.strip(AROUND_CELLS)
            for c in cells
        ]

    def numbers(self, separator: str | None) -> tuple[bool, ...]:
        """Which cells are numbers, times of the day, or empty."""
        cells = self.cells(separator)
        return tuple(_is_number(c if separator == "," else c.replace(",", ".")) for c in cells)


def _is_number(cell: str) -> bool:
    known = cell.casefold() in NO_NUMBERS or re.match(CLOCK, cell)
    return bool(known) or not np.isnan(number(cell))


def read_header(path: Path) -> Header:
    """The names of the columns: in a line above the samples, or the last comment there.

    That has as many cells as the samples; a line of units below adds them to the names. Columns
    without names are called 1, 2, 3.
    """
    comment, lines = _first_lines(path)
    separator = _separator(lines)
    width = _usual(len(line.cells(separator)) for line in lines[1:] or lines)
    numbers = [line.numbers(separator) for line in lines]
    usual = _usual(each for each in numbers[1:] or numbers if len(each) == width)
    # Samples have numbers where most lines have them.
    samples = [k for k, each in enumerate(numbers) if each == usual and any(each)]
    above = lines[: samples[0]] if samples else lines[:1]
    # Whether all samples end with a separator.
    spare = bool(samples) and not any(lines[k].cells(separator)[-1] for k in samples)
    found = [_names(line, separator, width, spare) for line in above]
    # A title may be filled up with empty cells; what stands below the names may be their units.
    said = [0 if _are_units(cells) else sum(not _is_number(c) for c in cells) for cells in found]
    if any(found):
        named = max((k for k in range(len(found)) if found[k]), key=said.__getitem__)
        names, last = found[named], above[named].row
        units = above[named + 1].cells(separator) if named + 1 < len(above) else []
        if len(units) == len(names) and _are_units(units):
            last = above[named + 1].row
            pairs = zip(names, map(_unit, units), strict=True)
            names = [name if unit in NO_UNITS else f"{name} [{unit}]" for name, unit in pairs]
        return _header(path, names, separator, last)
    garbled = [line for line in above if any(map(_is_number, filter(None, line.cells(separator))))]
    if above and not garbled and len(names := above[-1].cells(separator)) > 1:
        return _header(path, names, separator, above[-1].row)  # rows below may be garbled
    first = (garbled or lines[len(above) :])[0].row
    names = _names(Line(0, comment), separator, width, spare) or [str(k + 1) for k in range(width)]
    return _header(path, names, separator, first - 1)


def _header(path: Path, names: Sequence[str], separator: str | None, lines: int) -> Header:
    """The header, whose names must differ."""
    repeated = sorted(name for name, count in Counter(names).items() if name and count > 1)
    if repeated:
        raise LogError(f"{path}: its header names column {repeated[0]!r} more than once", file=path)
    return Header(tuple(names), separator, lines)


def _names(line: Line, separator: str | None, width: int, spare: bool) -> list[str]:
    """A number of names in a line, with that separator or, without it, others; else none.

    Separators at the end of the line do not count. Nor do those of all samples, which have a spare
    cell.
    """
    others = SEPARATORS if separator is None or len(line.cells(separator)) == 1 else ()
    for one in (separator, *others):
        cells = line.cells(one)
        if len(cells) == width + 1 and not cells[-1]:
            cells = cells[:-1]
        if len(cells) == width - 1 and spare:
            cells = [*cells, ""]
        if len(cells) == width and not all(line.numbers(one)):
            return cells
    return []


def _unit(cell: str) -> str:
    return cell.strip(AROUND_UNITS)


def _are_units(cells: Iterable[str]) -> bool:
    """Whether cells of a line below the header are units, some perhaps unknown."""
    named = [cell for cell in map(_unit, cells) if cell not in NO_UNITS]
    return bool(named) and 2 * sum(map(is_unit, named)) > len(named)


def _first_lines(path: Path) -> tuple[str, list[Line]]:
    """The last comment at the head of a file, and the first lines below it."""
    comment, lines, looked_at = "", list[Line](), 0
    with closing(text_blocks(path)) as blocks:
        for row, data in enumerate(chain.from_iterable(map(BytesIO, blocks)), 1):
            text = _decoded(data).rstrip("\r\n")
            text = text.removeprefix("\ufeff") if row == 1 else text
            if not lines and not text.replace("\t", " ").isprintable():
                wide = ": is it in UTF-16? Save it in UTF-8" if "\x00" in text else ""
                said = f"{path} is no text: row {row} is {shown(text)}{wide}"
                raise LogError(said, file=path)
            if not lines and text.startswith(COMMENTS):
                comment = text.lstrip("".join(COMMENTS)).strip()
            elif text.strip():
                lines.append(Line(row, text))
            looked_at += len(text)
            if len(lines) == LOOKED_AT or (looked_at > LONGEST_LINE and len(lines) >= LEAST_LINES):
                break
    if not lines:
        raise LogError(f"{path} is empty{', but for comments' if comment else ''}", file=path)
    return comment, lines


def _separator(lines: Sequence[Line]) -> str | None:
    """What splits samples into most numbers, and the header into as many names."""

    def merit(separator: str | None) -> tuple[bool, bool, bool, int]:
        rows = lines[1:] or lines
        width = _usual(len(line.cells(separator)) for line in rows)
        numeric = sum(all(line.numbers(separator)) for line in rows)
        named = len(lines[0].cells(separator)) == width
        return 2 * numeric > len(rows), width > 1, named, width

    return max(SEPARATORS, key=merit)


def _usual(items: Iterable[Item]) -> Item:
    """The most frequent of some items, the first of those that are equally so."""
    return Counter(items).most_common(1)[0][0]


# ---- tables whose cells hold the names of joints ----------------------------------------------

# Columns with a name, as "field.name0" of rostopic or "name_0" of bagpy; between commas.
NAME, BETWEEN = re.compile(r"((?:.*[./])?)name([_.\[]?)(\d+)(\]?)"), re.compile(r"[,;\t]")
FIELD = "field."  # that all columns of rostopic but the first begin with
QUANTITIES = {"position": "position", "velocity": "velocity", "effort": "force"}
STAMP = f"{FIELD}header.stamp"
TIME = "time [ns]"


class RostopicFormat(TextFormat):
    """As ``rostopic echo -p`` and bagpy write: columns go by the names of the joints beside them.

    Times are those of the messages.
    """

    @classmethod
    def accepts(cls, path: Path) -> bool:
        if path.is_dir() or not super().accepts(path):
            return False
        with path.open("rb") as file:
            header = file.readline(LONGEST_LINE).decode("latin-1")
        return any(NAME.fullmatch(cell.strip(' "\r\n')) for cell in BETWEEN.split(header))

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {stream: tuple(self._written) for stream in super().columns()}

    def tables(self, stream: str, times: Sequence[str], values: Sequence[str]) -> Sequence[Table]:
        own = [self._written[name] for name in times], [self._written[name] for name in values]
        called = {self._written[name]: name for name in (*times, *values)}
        return [
            table._replace(cells=table.cells.rename(called))
            for table in super().tables(stream, *own)
        ]

    @cached_property
    def _written(self) -> dict[str, str]:
        """Columns by what they hold: ``joint.quantity`` and the time."""
        ((stream, names),) = super().columns().items()
        cells = {name: match for name in names if (match := NAME.fullmatch(name))}
        of_rostopic = names[-1].startswith(FIELD)
        stamp = STAMP if STAMP in names else names[0]
        (table,) = super().tables(stream, [*cells, stamp], [])
        found = {name: name for name in names if name not in cells}
        if of_rostopic:
            found = {TIME: names[0] if (table.cells[stamp] == "0").all() else stamp}
        for column, cell in cells.items():
            said = table.cells[column].unique()
            if len(said) != 1:
                raise LogError(
                    f"{self.path}: column {column!r} names different joints, so that its numbers "
                    f"are of several: {', '.join(map(str, said.head(LOOKED_AT)))}",
                    file=self.path,
                )
            before, mark, number, after = cell.groups()
            for word, quantity in QUANTITIES.items():
                values = f"{before}{word}{mark}{number}{after}"
                if values in names:
                    found.pop(values, None)
                    found[f"{str(said[0]).strip()}.{quantity}"] = values
        return found
