"""One look for tables, which never break a name or a number, and for records as JSON.

Names come from files of any origin: nothing in them may steer a terminal.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from loopid.errors import one_line, short_name
from loopid.numbers import number
from loopid.records import json_value

SHORTEST = 12  # columns that a name is shortened to, if at all
WIDEST = 18  # columns of a heading's word, about those of a value with its deviation


class Words:
    """Text in a cell: it breaks between words, and a word that is too long loses its middle."""

    def __init__(self, text: str, style: str = "", whole: bool = False) -> None:
        self.text, self.style = "\n".join(map(one_line, text.split("\n"))), style
        self.whole = whole  # as a number is: never broken, never shortened

    def __str__(self) -> str:
        return self.text

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        if self.whole:
            return Measurement(cell_len(self.text), cell_len(self.text))
        longest = max(map(cell_len, self.text.split()), default=0)
        return Measurement(min(longest, SHORTEST), max(map(cell_len, self.text.split("\n"))))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        text = self.text
        if not self.whole:
            text = re.sub(r"[^ \n]+", lambda word: short_name(word[0], options.max_width), text)
        yield Text(text, self.style, no_wrap=self.whole)


class Heading(Words):
    """Text above a column, which is as wide as its longest word, if that is short."""

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        longest = max(map(cell_len, self.text.split()), default=0)
        return Measurement(min(longest, WIDEST), min(longest, WIDEST))


def plain_table(title: str, columns: Sequence[str], rows: Iterable[Iterable[object]]) -> Table:
    """A table whose cells are shown as they are; columns that begin with ``>`` hold numbers.

    Columns without names have no header; a table without a title has no rules and little room.
    """
    headed = any(name.strip(">") for name in columns)
    table = Table(
        title=Words(title, "bold") if title else None,  # type: ignore[arg-type]
        title_justify="left",
        box=(box.SIMPLE_HEAD if headed else box.SIMPLE) if title else None,
        padding=(0, 1) if title else (0, 1, 0, 0),
        header_style="dim",
        show_header=headed,
    )
    numbers = [name[:1] == ">" for name in columns]
    for name, whole in zip(columns, numbers, strict=True):
        side: Any = "right" if whole else "left"
        table.add_column(Heading(name.removeprefix(">")), justify=side, no_wrap=whole)
    for row in rows:
        table.add_row(
            *(Words(str(cell), whole=own) for cell, own in zip(row, numbers, strict=True))
        )
    return table


def facts(title: str, entries: Mapping[str, object]) -> Table:
    """A table of names and what is said of them, if anything is."""
    return plain_table(title, ("", ""), ((name, said) for name, said in entries.items() if said))


def table_of(title: str, columns: Mapping[str, Any], things: Iterable[Any]) -> Table:
    """A row a thing, with columns as of ``plain_table``.

    A column is a function of the thing, or names an attribute or key of it, with a format or
    without: ``"mass:.4g"``. What is None, infinite or NaN is a dash.
    """
    rows = ([_cell(thing, column) for column in columns.values()] for thing in things)
    return plain_table(title, tuple(columns), rows)


def _cell(thing: Any, column: Any) -> str:
    if not isinstance(column, str):
        value, form = column(thing), ""
    else:
        name, _, form = column.partition(":")
        value = thing[name] if isinstance(thing, Mapping) else getattr(thing, name)
    if value is None or (isinstance(value, float) and not (form and math.isfinite(value))):
        return number(value)
    return format(value, form)


def json_text(record: Any) -> str:
    """A record as JSON; what is not printable, such as a terminal's control codes, as escapes."""
    text = json.dumps(record, indent=2, ensure_ascii=False)
    return re.sub(
        r"[^\n -~]", lambda c: c[0] if c[0].isprintable() else json.dumps(c[0])[1:-1], text
    )


def json_fields(thing: object, *names: str) -> dict[str, Any]:
    """Attributes by name, ready for JSON."""
    return {name: json_value(getattr(thing, name)) for name in names}


def rounded(value: Any) -> Any:
    """What is ready for JSON, with six digits a number."""
    if isinstance(value, dict):
        return {key: rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        return [rounded(each) for each in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value
