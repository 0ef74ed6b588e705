"""Tables and files for benchmark figures."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from math import isfinite, nan
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

# Characters, whatever the terminal: figures cut short are no use in a log file.
WIDEST = 200


def parts_of(parser: argparse.ArgumentParser, given: list[str], known: Iterable[str]) -> list[str]:
    """Parts of a benchmark that were asked for, by default all; an unknown one ends it."""
    every = [*known]
    for part in given:
        if part not in every:
            parser.error(f"unknown part {part!r}: choose among {', '.join(every)}")
    return given or every


def show(title: str, rows: list[dict[str, Any]]) -> None:
    """Print rows as a table; where one lacks a key, "-" stands."""
    table = Table(title=title, title_justify="left")
    columns: dict[str, Any] = {}
    for row in rows:
        columns = row | columns
    for key, value in columns.items():
        words = isinstance(value, str)
        table.add_column(
            key.replace("_", " "), justify="left" if words else "right", overflow="fold"
        )
    for row in rows:
        table.add_row(*(_text(row.get(key, nan)) for key in columns))
    Console(width=WIDEST).print(table)


def write_json(path: str, figures: dict[str, Any]) -> None:
    """Write figures to a file; NaN and infinity, which JSON has not, become null."""
    Path(path).write_text(json.dumps(_finite(figures), indent=2) + "\n")


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return "-" if value != value else f"{value:,.6g}"
    return str(value)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not isfinite(value) else value
