"""One look for all tables, in the terminal and as Markdown, and records as JSON.

Names come from files of any origin: nothing in them may steer a terminal or be live on a page.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from loopid.errors import one_line

# What Markdown or HTML may take for markup: written as entities, which never are.
MARKUP = re.compile(r"[&<>\[\]|\\`*~$]|(?<![^\W_])_+|_+(?![^\W_])|(?<=\w):(?=//)")


def plain_text(text: str, style: str = "") -> Text:
    """Text that is printed as it is, what is not printable but ends of lines as escapes."""
    return Text("\n".join(map(one_line, text.split("\n"))), style)


def plain_table(title: str, columns: Sequence[str], rows: Iterable[Iterable[object]]) -> Table:
    """A table whose cells are shown as they are; columns that begin with ``>`` are aligned right.

    Columns without names have no header.
    """
    headed = any(name.strip(">") for name in columns)
    table = Table(
        title=plain_text(title, "bold") if title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD if headed else box.SIMPLE,
        show_header=headed,
    )
    for name in columns:
        side: Any = "right" if name[:1] == ">" else "left"
        table.add_column(name.removeprefix(">"), justify=side, overflow="fold")
    for row in rows:
        table.add_row(*(plain_text(str(cell)) for cell in row))
    return table


def facts(title: str, entries: Mapping[str, object]) -> Table:
    """A table of names and what is said of them."""
    return plain_table(title, ("", ""), entries.items())


def markdown_page(title: str, tables: Iterable[Table], captions: Mapping[str, str]) -> str:
    """Tables, then figures by the names of their files, as Markdown under a title."""
    parts = [f"# {markdown_text(title)}", "", *map(markdown_table, tables)]
    parts += [f"![{text}]({figure}.svg)\n\n{text}\n" for figure, text in captions.items()]
    return "\n".join(parts)


def markdown_table(table: Table) -> str:
    """A table as Markdown under its title."""
    columns = [[markdown_text(str(cell)) for cell in column.cells] for column in table.columns]
    head = [markdown_text(str(column.header)) for column in table.columns]
    rules = ["---:" if column.justify == "right" else "---" for column in table.columns]
    lines = [head, rules, *map(list, zip(*columns, strict=True))]
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    title = f"**{markdown_text(str(table.title))}**\n\n" if table.title else ""
    caption = f"\n{markdown_text(str(table.caption))}\n" if table.caption else ""
    return f"{title}{body}\n{caption}"


def markdown_text(text: str) -> str:
    """Text that Markdown shows as it is, on one line."""
    line = one_line(text.replace("\n", " "))
    return MARKUP.sub(lambda found: "".join(f"&#{ord(c)};" for c in found[0]), line)


def json_text(record: Any) -> str:
    """A record as JSON; what is not printable, such as a terminal's control codes, as escapes."""
    text = json.dumps(record, indent=2, ensure_ascii=False)
    return re.sub(
        r"[^\n -~]", lambda c: c[0] if c[0].isprintable() else json.dumps(c[0])[1:-1], text
    )


def json_fields(thing: object, *names: str) -> dict[str, Any]:
    """Attributes by name, ready for JSON."""
    return {name: json_value(getattr(thing, name)) for name in names}


def json_value(value: Any) -> Any:
    """Lists of numbers and texts; null for infinity and NaN, which JSON lacks."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [json_value(each) for each in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
