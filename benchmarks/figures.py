"""The tables of docs/benchmarks.md, made of what commands have measured.

    python benchmarks/figures.py [NAME ...]

runs the commands of these names, such as ``startup``, each of which writes ``figures/NAME.json``.
Then it writes all tables of the page anew; in the page a comment names file and key of the rows.
Commands with a word such as ``<folder>`` need data of others: give such a command by hand, with
``--json benchmarks/figures/NAME.json``.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
PAGE, STORED = HERE.parent / "docs" / "benchmarks.md", HERE / "figures"
COMMANDS = {
    "startup": "startup.py",
    "search": "search.py",
    "observation": "observation.py",
    "single": "observation.py --single",
    "logs": "logs.py --jobs 1",
    "codegen": "codegen.py",
    "motions": "codegen.py --motions 5000 five_bar 3ups_rpu",
    "payload_arm": "payloads.py --real <robot> <unloaded> <loaded> <link> <kg>",
    "real_logs": "real_logs.py <folder>",
    "speed": "control.py speed",
    "updates": "control.py updates",
    "observer": "control.py alarms wrench coverage",
    "observed_log": "control.py log --log <folder>",
    "payload": 'control.py payload --seeds 5 --laws PID+G "PID+G adaptive" "PID+G online"',
    "payload_1khz": 'control.py payload --seeds 1 --rate 1000 --laws PID+G "PID+G adaptive"',
    "certificates": "certificates.py --time-limit 10",
    "peers": "peers.py --threads 1 --runs 1",
}
# By file and key, the heading of a table and how a row is written; ``:3`` is three digits.
MOTORS = [f"{name}_joint" for name in "shoulder_pan shoulder_lift elbow".split()] + [
    f"wrist_{k}_joint" for k in (1, 2, 3)
]
SPANS = "{before} | {on} | {settled} | {off} | {after}"
PAYLOAD = (
    "| law | before, 10-20 s | on, 20-22 s | settled, 30-40 s | off, 40-42 s | after, 50-60 s |",
    f"| {{law}} | {SPANS} |",
)
TABLES = {
    "startup: commands": (
        "| command | seconds | modules | of loopid |",
        "| `loopid {command}` | {seconds:2} | {modules:,} | {of_loopid} |",
    ),
    "search: strategies": (
        "| search | cond(V22) | proven best | choices as good | time | ratio |  |",
        "| {search} | {condition_number:5} | {certified} | {ties:,} | {seconds:2} s | {ratio:2} "
        "| {how} |",
    ),
    "observation: observation": (
        "| robot, model | rows x columns | bare, µs | regressor / bare |",
        "| {robot}, {model} | {rows_x_columns} | {bare:2} | {regressor / bare:2} |",
    ),
    "observation: assembly": (
        "| robot | assembly, µs | bare, µs | assembly / bare |",
        "| {robot} | {assembly:2} | {bare:2} | {assembly / bare:2} |",
    ),
    "single: single": (
        "| robot | bare, µs | gravity / bare | assembly + forces / bare |",
        "| {robot} | {bare:2} | {gravity / bare:2} | {assembly + forces / bare:2} |",
    ),
    "logs: logs": (
        "| log | rows | fitted | read, s | prepare, s | regressor, s | fit, s | most memory, MB |",
        "| {log} | {samples:,} | {fitted:,} | {read_s:2} | {prepare_s:2} | {regressor_s:2} "
        "| {fit_s:2} | {peak_MB:3} |",
    ),
    "codegen: samples": (
        "| robot, model | assembly, µs | with gravity | with forces | Python, µs | difference |",
        "| {robot}, {model} | {µs assembly:2} | {µs gravity:2} | {µs forces:2} "
        "| {µs in Python:2} | {largest difference:1} |",
    ),
    "motions: motions": (
        "| robot | Newton steps | way, m or rad | motions | refused | other branch than Python |",
        "| {robot} | {Newton steps} | {way, m or rad} | {motions:,} | {refused} | {elsewhere} |",
    ),
    "payload_arm: payloads": (
        f"| model | mass, kg | 95 % interval | motors disagree | {' | '.join(MOTORS)} |",
        f"| {{model}} | {{mass:3}} | {{from:3}} to {{to:3}} | {{disagree}} "
        f"| {' | '.join(f'{{{name}}}' for name in MOTORS)} |",
    ),
    "real_logs: errors": (
        f"| fit of | judged on | terms | {' | '.join(MOTORS)} |",
        f"| {{fit of}} | {{judged on}} | `{{by}}` "
        f"| {' | '.join(f'{{{name}:2}}' for name in MOTORS)} |",
    ),
    "real_logs: agreement": (
        "| fits of | terms | differences | below 1.96, % | largest | of |",
        "| {fits of} | `{terms}` | {differences} | {usual %:3} | {largest:2} | `{of}` |",
    ),
    "speed: speed": ("| call | µs |", "| {call} | {µs:2} |"),
    "updates: updates": (
        "| forgetting | updates | largest before | largest after | positive definite |",
        "| {forgetting} | {updates:,} | {largest deviation before:2} "
        "| {largest after:2} | {positive definite} |",
    ),
    "observer: alarms": (
        "| friction off, % | hours | alarms |",
        "| {friction off %:2} | {hours} | {alarms} |",
    ),
    "observer: wrench": (
        "| friction off, % | N or N m | median time, ms | within 100 ms, % | stated floor |",
        "| {friction off %:2} | {wrench} | {median ms:3} | {within 100 ms %:3} "
        "| {stated floor:2} |",
    ),
    "observer: coverage": (
        "| robots | inside, % | least of a motor, % | most of a motor, % |",
        "| {robots} | {inside %:3} | {least of a motor %:3} | {most of a motor %:3} |",
    ),
    "observed_log: log": (
        "| N and N m | samples | Fx | Fz | Mx | My | Mz |",
        "| {N and N m} | {samples} | {Fx:2} | {Fz:2} | {Mx:2} | {My:2} | {Mz:2} |",
    ),
    "payload: payload": PAYLOAD,
    "payload_1khz: payload": PAYLOAD,
    "certificates: summary": (
        "| robots | searches | certified | slowest certificate, s | largest gap |",
        "| {group} | {robots} | {certified} | {slowest_certificate_s:2} | {worst_gap:3} |",
    ),
    "peers: ratios": (
        "| case | columns | with effect | rank | FIGAROH's time / loopid's | FIGAROH, MB | loopid, MB |",
        "| {case} | {columns} | {with_effect} | {rank} | {time:2} | {FIGAROH_MB:3} "
        "| {loopid_MB:3} |",
    ),
}
MARKED = re.compile(r"(<!-- (\w+: \w+) -->\n\n)((?:\|.*\n)*)")


class Figure(float):
    """A number that is written with some significant digits."""

    def __format__(self, digits: str) -> str:
        rounded = float(f"{float(self):.{digits}g}")
        return f"{rounded:.0e}" if 0 < abs(rounded) < 1e-4 else f"{rounded:,.10g}"


class Missing:
    """What was not measured, or has no limit."""

    def __format__(self, digits: str) -> str:
        return "-"


def main() -> None:
    """Measure what is named, and write the page."""
    for name in sys.argv[1:]:
        measure(name)
    PAGE.write_text(with_tables(PAGE.read_text()))


def measure(name: str) -> None:
    """Run the command of a name, which writes its figures."""
    if name not in COMMANDS:
        raise SystemExit(f"{name} is none of {', '.join(COMMANDS)}")
    script, *words = shlex.split(COMMANDS[name])
    if any(word.startswith("<") for word in words):
        raise SystemExit(f"{name} needs data of others: {COMMANDS[name]}")
    command = [sys.executable, HERE / script, *words, "--json", STORED / f"{name}.json"]
    subprocess.run(command, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"}, check=True)


def with_tables(page: str) -> str:
    """The page with its tables of what is stored."""

    def table(found: re.Match[str]) -> str:
        name, _, key = found[2].partition(": ")
        heading, row = TABLES[found[2]]
        rows = json.loads((STORED / f"{name}.json").read_text())[key]
        written = [
            row.format(**{each: _written(x) for each, x in values.items()}) for values in rows
        ]
        lines = [heading, "| --- " * (heading.count("|") - 1) + "|", *written]
        return found[1] + "".join(f"{line}\n" for line in lines)

    return MARKED.sub(table, page)


def _written(value: Any) -> Any:
    if value is None:
        return Missing()
    if isinstance(value, bool):
        return "yes" if value else "no"
    return Figure(value) if isinstance(value, float) else value


if __name__ == "__main__":
    main()
