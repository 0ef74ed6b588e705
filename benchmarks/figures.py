"""The tables of docs/benchmarks.md that are made by a command.

    python benchmarks/figures.py [NAME ...] [--data DIR]

runs scripts, such as ``startup.py``, or single commands, such as ``"control.py speed"``. What they
measure is kept in figures.json, and the tables of the page are written anew. In the page a comment
names the command and the key of its rows. ``DIR`` in a command is the folder of ``--data``: real
logs, which are no part of the project.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

HERE = Path(__file__).parent
PAGE, STORED = HERE.parent / "docs" / "benchmarks.md", HERE / "figures.json"
REAL = "real_logs.py DIR --only fourier_30s point_to_point unloaded_50s"
PAYLOAD = (
    "payloads.py --real DIR/ur10e.urdf DIR/unloaded_50s.csv.gz DIR/loaded_50s.csv.gz "
    "wrist_3_link 2.805"
)
LAWS = "control.py payload --seeds 5 --laws PID+G 'PID+G adaptive' 'PID+G online'"
PROVEN = "certificates.py --time-limit 10 --only '[0-9bdfp]*'"
PEERS = "peers.py --threads 1 --runs 1"
JOINTS = {
    **{"shoulder pan": "shoulder_pan_joint", "lift": "shoulder_lift_joint", "elbow": "elbow_joint"},
    **{f"wrist {k}": f"wrist_{k}_joint" for k in (1, 2, 3)},
}
WRENCH = ("Fx", "Fz", "Mx", "My", "Mz")
SPANS = ("before", "on", "settled", "off", "after")
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
    "logs.py --samples 10000 1000000 --jobs 1: logs": {
        **{"log": "{log}", "rows": "{samples:,}", "fitted": "{fitted:,}", "MB": "{peak_MB:3}"},
    },
    f"{PAYLOAD}: payloads": {
        **{"model": "{model}", "mass, kg": "{mass:3}", "95 %": "{from:3} to {to:3}"},
        **{name: f"{{{joint}}}" for name, joint in JOINTS.items()},
    },
    f"{REAL}: errors": {
        **{"fit of": "{fit of}", "judged on": "{judged on}", "terms": "`{by}`"},
        **{name: f"{{{joint}:2}}" for name, joint in JOINTS.items()},
    },
    f"{REAL}: agreement": {
        **{"fits of": "{fits of}", "terms": "`{terms}`", "differences": "{differences}"},
        **{"usual": "{usual %:3} %", "largest": "{largest:2}", "of": "`{of}`"},
    },
    "control.py speed: speed": {"call": "{call}", "µs": "{µs:2}"},
    "control.py updates --updates 100000: updates": {
        **{"forgetting": "{forgetting}", "updates": "{updates:,}"},
        **{"largest deviation before": "{largest deviation before:2}"},
        **{"after": "{largest after:2}", "positive definite": "{positive definite}"},
    },
    "control.py wrench coverage: wrench": {
        **{"friction off": "{friction off}", "N or N m": "{wrench}", "median, ms": "{median ms:2}"},
        **{"within 100 ms": "{within 100 ms %:3} %", "stated floor": "{stated floor:2}"},
        **{"alarms in 10 h": "{alarms in 10 h}"},
    },
    "control.py wrench coverage: coverage": {
        **{"robots": "{robots}", "inside": "{inside %:3} %"},
        **{"by motor": "{least %:3} to {most %:3} %"},
    },
    "control.py log --log DIR: log": {
        **{"N and N m": "{N and N m}", "samples": "{samples}"},
        **{name: f"{{{name}:2}}" for name in WRENCH},
    },
    f"{LAWS}: payload": {"law": "{law}"}
    | {span: f"{{{span}}}" for span in SPANS}
    | {"found after, s": "{found after s:3}", "kg 10 s after": "{mass 10 s after, kg}"},
    f"{PROVEN}: summary": {
        **{"base or model": "{group}", "robots": "{robots}", "certified": "{certified}"},
        **{"slowest certificate": "{slowest_certificate_s:2} s", "largest gap": "{worst_gap:3}"},
        **{"refused": "{refused}"},
    },
    f"{PEERS}: ratios": {
        **{"case": "{case}", "time": "{time:2}", "memory": "{memory:2}"},
        **{"same rank": "{same_rank}", "residuals differ by": "{residuals_differ_by:1}"},
    },
    f"{PEERS}: sizes": {
        **{"case": "{case}", "package": "{package}", "columns": "{columns}"},
        **{"with effect": "{with_effect}", "rank": "{rank}", "MB": "{whole_chain:3}"},
    },
}
MARKED = re.compile(r"(<!-- ([^>]+: \w+) -->\n\n)((?:\|.*\n)*)")


class Figure(float):
    """A number that is written with some significant digits."""

    def __format__(self, digits: str) -> str:
        rounded = float(f"{float(self):.{digits}g}")
        plain = rounded == 0 or 1e-4 <= abs(rounded) < 1e7
        return f"{rounded:,.10g}" if plain else f"{rounded:.0e}"


class Missing:
    """What was not measured."""

    def __format__(self, digits: str) -> str:
        return "-"


def main() -> None:
    """Measure what is named, and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="scripts, or whole commands")
    parser.add_argument("--data", type=Path, metavar="DIR", help="of real logs")
    arguments = parser.parse_args()
    commands = dict.fromkeys(name.rpartition(": ")[0] for name in TABLES)
    for name in arguments.names:
        if not any(name in (each, each.split()[0]) for each in commands):
            raise SystemExit(f"no table is made by {name}: choose of {', '.join(commands)}")
    stored = json.loads(STORED.read_text()) if STORED.exists() else {}
    for command in commands:
        if not {command, command.split()[0]} & {*arguments.names}:
            continue
        if "DIR" in command and arguments.data is None:
            print(f"{command} is left out: it needs --data DIR")
            continue
        stored[command] = measured(command, arguments.data)
        STORED.write_text(json.dumps(stored, indent=1, ensure_ascii=False) + "\n")
    PAGE.write_text(with_tables(PAGE.read_text(), stored))


def measured(command: str, data: Path | None = None) -> dict[str, list[dict[str, Any]]]:
    """What a script writes."""
    with TemporaryDirectory() as folder:
        words = shlex.split(command)
        if data is not None:
            words = [word.replace("DIR", str(data.absolute())) for word in words]
        words = [sys.executable, *words, "--json", f"{folder}/figures.json"]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        subprocess.run(words, cwd=HERE, env=environment, check=True)
        found: dict[str, list[dict[str, Any]]] = json.loads(
            Path(folder, "figures.json").read_text()
        )
    return found


def with_tables(page: str, stored: dict[str, dict[str, list[dict[str, Any]]]]) -> str:
    """The page with its tables of what is stored."""

    def table(found: re.Match[str]) -> str:
        command, _, key = found[2].rpartition(": ")
        columns, kept = TABLES[found[2]], stored[command][key]
        unknown = {name: None for row in kept for name in row}
        rows = [
            [
                how.format(**{name: _written(x) for name, x in (unknown | row).items()})
                for how in columns.values()
            ]
            for row in kept
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
