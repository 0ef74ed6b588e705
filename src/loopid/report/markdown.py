"""Tables of the terminal as Markdown, so that both show the same cells."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text


def markdown_table(table: Table) -> str:
    """A rich table with plain cells as a Markdown table under its title."""
    columns = [[_cell(value) for value in column.cells] for column in table.columns]
    head = [_cell(column.header) for column in table.columns]
    rules = ["---:" if column.justify == "right" else "---" for column in table.columns]
    lines = [head, rules, *map(list, zip(*columns, strict=True))]
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    title = f"**{_plain(table.title)}**\n\n" if table.title else ""
    caption = f"\n{_plain(table.caption)}\n" if table.caption else ""
    return f"{title}{body}\n{caption}"


def _cell(value: object) -> str:
    return _plain(value).replace("|", r"\|").replace("\n", " ")


def _plain(value: object) -> str:
    return Text.from_markup(str(value)).plain
