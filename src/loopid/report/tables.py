"""One look for all tables, in the terminal and as Markdown."""

from __future__ import annotations

import math
from typing import Any

from rich import box
from rich.markup import escape
from rich.table import Table
from rich.text import Text


class PlainTable(Table):
    """A table that shows its cells as they are: names may hold what rich takes for markup."""

    def add_row(self, *cells: object, **options: Any) -> None:
        super().add_row(*(escape(str(cell)) for cell in cells), **options)


def plain_table(title: str, *columns: str) -> PlainTable:
    """A table with a title and columns; a name that begins with ``>`` is aligned right."""
    headed = any(name.strip(">") for name in columns)
    table = PlainTable(
        title=escape(title),
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD if headed else box.SIMPLE,
        show_header=headed,
    )
    for name in columns:
        table.add_column(name.removeprefix(">"), justify="right" if name[:1] == ">" else "left")
    return table


def markdown_table(table: Table) -> str:
    """A rich table with plain cells as a Markdown table under its title."""

    def plain(value: object) -> str:
        return Text.from_markup(str(value)).plain

    def cell(value: object) -> str:
        return plain(value).replace("|", r"\|").replace("\n", " ")

    columns = [[cell(value) for value in column.cells] for column in table.columns]
    head = [cell(column.header) for column in table.columns]
    rules = ["---:" if column.justify == "right" else "---" for column in table.columns]
    lines = [head, rules, *map(list, zip(*columns, strict=True))]
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    title = f"**{plain(table.title)}**\n\n" if table.title else ""
    caption = f"\n{plain(table.caption)}\n" if table.caption else ""
    return f"{title}{body}\n{caption}"


def json_number(value: float) -> float | None:
    """JSON has neither infinity nor NaN: null instead."""
    return float(value) if math.isfinite(value) else None
