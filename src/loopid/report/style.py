"""One look for all tables."""

from __future__ import annotations

from typing import Any

from rich import box
from rich.markup import escape
from rich.table import Table


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
