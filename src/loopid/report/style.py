"""One look for all tables."""

from __future__ import annotations

from rich import box
from rich.table import Table


def plain_table(title: str, *columns: str) -> Table:
    """A table with a title and columns; a name that begins with ``>`` is aligned right."""
    headed = any(name.strip(">") for name in columns)
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD if headed else box.SIMPLE,
        show_header=headed,
    )
    for name in columns:
        table.add_column(name.removeprefix(">"), justify="right" if name[:1] == ">" else "left")
    return table
