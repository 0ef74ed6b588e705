"""Logs of ``rostopic echo -p`` and bagpy: tables of text whose cells hold the joints' names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

from loopid.errors import LogError
from loopid.files import LONGEST_LINE
from loopid.formats.text import TextFormat
from loopid.logs.table import LOOKED_AT, Table

# Columns with a name, as "field.name0" of rostopic or "name_0" of bagpy; between commas.
NAME, BETWEEN = re.compile(r"((?:.*[./])?)name([_.\[]?)(\d+)(\]?)"), re.compile(r"[,;\t]")
FIELD = "field."  # that all columns of rostopic but the first begin with
QUANTITIES = {"position": "position", "velocity": "velocity", "effort": "force"}
STAMP = f"{FIELD}header.stamp"
TIME = "time [ns]"


class RostopicFormat(TextFormat):
    """Columns of a JointState go by the names beside them; times are those of the messages."""

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
