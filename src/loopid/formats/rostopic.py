"""Logs of ``rostopic echo -p``: a table of text whose cells hold the names of the joints."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

from loopid.errors import LogError
from loopid.files import LONGEST_LINE
from loopid.formats.text import TextFormat
from loopid.logs.table import LOOKED_AT, Table

FIRST = b"%time,field."  # bytes of such a file
QUANTITIES = {"position": "position", "velocity": "velocity", "effort": "force"}
STAMP = "field.header.stamp"
TIME = "time [ns]"


class RostopicFormat(TextFormat):
    """Columns of a JointState go by the names beside them; times are those of the messages."""

    @classmethod
    def accepts(cls, path: Path) -> bool:
        if path.is_dir() or not super().accepts(path):
            return False
        with path.open("rb") as file:
            header = file.readline(LONGEST_LINE)
            return header.startswith(FIRST) and b",field.name0," in header

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
        cells = re.compile(r"field\.name(\d+)")
        numbers = {name: match[1] for name in names if (match := cells.fullmatch(name))}
        stamp = STAMP if STAMP in names else names[0]
        (table,) = super().tables(stream, [*numbers, stamp], [])
        joints = {}
        for column, number in numbers.items():
            said = table.cells[column].unique()
            if len(said) != 1:
                raise LogError(
                    f"{self.path}: column {column!r} names different joints, so that its numbers "
                    f"are of several: {', '.join(map(str, said.head(LOOKED_AT)))}",
                    file=self.path,
                )
            joints[number] = str(said[0]).strip()
        found = {TIME: names[0] if (table.cells[stamp] == "0").all() else stamp}
        for number, joint in joints.items():
            for word, quantity in QUANTITIES.items():
                if (column := f"field.{word}{number}") in names:
                    found[f"{joint}.{quantity}"] = column
        return found
