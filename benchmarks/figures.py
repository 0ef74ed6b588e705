"""The tables of docs/benchmarks.md that are made by a command.

    python benchmarks/figures.py [SCRIPT ...]

runs the named scripts, such as ``startup.py``, keeps what they measure in figures.json, and
writes the tables of the page anew. In the page a comment names the command and the key of its rows.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

HERE = Path(__file__).parent
PAGE, STORED = HERE.parent / "docs" / "benchmarks.md", HERE / "figures.json"
# By command and key, the columns: a heading, and how a row is written; ``:3`` is three digits.
TABLES = {
    "startup.py: commands": {
        **{"command": "`loopid {command}`", "seconds": "{seconds:2}"},
        **{"modules": "{modules:,}", "of loopid": "{of_loopid}"},
    },
    "search.py: strategies": {
        **{"search": "{search}", "cond(V22)": "{condition_number:5}", "proven best": "{certified}"},
        **{"time": "{seconds:2} s", "ratio": "{ratio:2}", "": "{how}"},
    },
    "observation.py: observation": {
        **{"robot, model": "{robot}, {model}", "rows x columns": "{rows_x_columns}"},
        **{"bare, µs": "{bare:2}", "regressor / bare": "{regressor / bare:2}"},
    },
    "observation.py: assembly": {
        **{"robot": "{robot}", "assembly, µs": "{assembly:2}", "bare, µs": "{bare:2}"},
        **{"assembly / bare": "{assembly / bare:2}"},
    },
    "observation.py --single: single": {
        **{"robot": "{robot}", "bare, µs": "{bare:2}", "gravity / bare": "{gravity / bare:2}"},
        **{"assembly + forces / bare": "{assembly + forces / bare:2}"},
    },
    "codegen.py: samples": {
        **{"robot, model": "{robot}, {model}", "assembly, µs": "{µs assembly:2}"},
        **{"with gravity": "{µs gravity:2}", "with forces": "{µs forces:2}"},
        **{"Python, µs": "{µs in Python:2}", "difference": "{largest difference:1}"},
    },
}
MARKED = re.compile(r"(<!-- ([\w. -]+: \w+) -->\n\n)((?:\|.*\n)*)")


class Figure(float):
    """A number that is written with some significant digits."""

    def __format__(self, digits: str) -> str:
        rounded = float(f"{float(self):.{digits}g}")
        return f"{rounded:.0e}" if 0 < abs(rounded) < 1e-4 else f"{rounded:,.10g}"


class Missing:
    """What was not measured."""

    def __format__(self, digits: str) -> str:
        return "-"


def main() -> None:
    """Measure what is named, and write the page."""
    stored = json.loads(STORED.read_text()) if STORED.exists() else {}
    for command in dict.fromkeys(name.partition(":")[0] for name in TABLES):
        if command.split()[0] in sys.argv[1:]:
            stored[command] = measured(command)
            STORED.write_text(json.dumps(stored, indent=1, ensure_ascii=False) + "\n")
    PAGE.write_text(with_tables(PAGE.read_text(), stored))


def measured(command: str) -> dict[str, list[dict[str, Any]]]:
    """What a script writes."""
    with TemporaryDirectory() as folder:
        words = [sys.executable, *command.split(), "--json", f"{folder}/figures.json"]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        subprocess.run(words, cwd=HERE, env=environment, check=True)
        found: dict[str, list[dict[str, Any]]] = json.loads(
            Path(folder, "figures.json").read_text()
        )
    return found


def with_tables(page: str, stored: dict[str, dict[str, list[dict[str, Any]]]]) -> str:
    """The page with its tables of what is stored."""

    def table(found: re.Match[str]) -> str:
        command, _, key = found[2].partition(": ")
        columns = TABLES[found[2]]
        rows = [
            [
                how.format(**{name: _written(x) for name, x in row.items()})
                for how in columns.values()
            ]
            for row in stored[command][key]
        ]
        lines = [[*columns], ["---"] * len(columns), *rows]
        return found[1] + "".join(f"| {' | '.join(line)} |\n" for line in lines)

    return MARKED.sub(table, page)


def _written(value: Any) -> Any:
    if value is None:
        return Missing()
    if isinstance(value, bool):
        return "yes" if value else "no"
    return Figure(value) if isinstance(value, float) else value


if __name__ == "__main__":
    main()
