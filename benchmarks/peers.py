"""FIGAROH and loopid side by side: the same URDFs, the same random states, the same parameters.

    make peers     # once: an environment for FIGAROH, whose dependencies stay out of loopid's
    python benchmarks/peers.py [--only PATTERN] [--runs N] [--threads N] [--json FILE]

From the regressor to base parameters and their least-squares values with standard deviations,
without friction, each run in a process of its own. Forces are simulated, with seeded noise.
Joints that mimic others move on their own, as FIGAROH has them.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from fnmatch import fnmatch
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from peers_cases import CASES, Case, simulated
from tables import show, write_json

Figures = dict[str, Any]

HERE = Path(__file__).parent
FIGAROH = HERE.parent / ".venv" / "peers" / "bin" / "python"
PHASES = (
    "load",
    "regressor",
    "triangular factor",
    "zero columns",
    "base parameters",
    "least squares",
)
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")


def main() -> None:
    """Print phases and ratios, and write them on request."""
    arguments = _arguments()
    if not arguments.figaroh.is_file():
        raise SystemExit(f"{arguments.figaroh} is missing: 'make peers' installs FIGAROH")
    cases = [case for case in CASES if fnmatch(case.title, arguments.only)]
    if not cases:
        raise SystemExit(f"no case is called {arguments.only}: {', '.join(c.title for c in CASES)}")
    found = {case.title: measured(case, arguments) for case in cases}
    seconds, sizes = _each(found, _seconds), _each(found, _sizes)
    ratios = [{"case": case, **_ratios(**figures)} for case, figures in found.items()]
    show(f"seconds of each phase, medians of {arguments.runs} runs", seconds)
    show("parameters, and the most memory held in MB", sizes)
    show("FIGAROH over loopid, from the regressor to least squares", ratios)
    if arguments.json:
        write_json(arguments.json, {"seconds": seconds, "sizes": sizes, "ratios": ratios})


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", default="*", metavar="PATTERN", help="cases, such as 'UR10*'")
    parser.add_argument("--runs", type=int, default=3, metavar="N")
    parser.add_argument("--threads", metavar="N", help="of BLAS, for both; by default its own")
    parser.add_argument("--exact-limit", type=float, default=10.0, metavar="S", help="0 for none")
    parser.add_argument("--figaroh", type=Path, default=FIGAROH, metavar="PYTHON", help="of peers")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    return parser.parse_args()


def measured(case: Case, arguments: argparse.Namespace) -> dict[str, list[Figures]]:
    """Figures of all runs of each package, taken in turn so that drift hits both."""
    figures: dict[str, list[Figures]] = {"figaroh": [], "loopid": []}
    with TemporaryDirectory() as folder:
        states = simulated(case, Path(folder) / "states").as_argument()
        for run in range(arguments.runs):
            limit = str(0 if run else arguments.exact_limit)
            theirs = [str(arguments.figaroh.absolute()), "peers_figaroh.py", states]
            ours = [sys.executable, "peers_loopid.py", states, limit]
            for package, command in (("figaroh", theirs), ("loopid", ours)):
                figures[package].append(_run(command, arguments.threads))
    return figures


def _run(command: list[str], threads: str | None) -> Figures:
    limits = {} if threads is None else dict.fromkeys(THREADS, threads)
    environment = {**os.environ, **limits}
    done = subprocess.run(command, cwd=HERE, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{command[1]} failed:\n{done.stderr}")
    figures: Figures = json.loads(done.stdout.splitlines()[-1])
    return figures


def _each(
    found: dict[str, dict[str, list[Figures]]], figures: Callable[[list[Figures]], Figures]
) -> list[Figures]:
    """A row for each case and package."""
    return [
        {"case": case, "package": package, **figures(runs)}
        for case, packages in found.items()
        for package, runs in packages.items()
    ]


def _seconds(runs: list[Figures]) -> Figures:
    exact = runs[0].get("exact") or {"certified": False}
    phases = {
        phase: float(median(run["seconds"].get(phase, np.nan) for run in runs)) for phase in PHASES
    }
    return {
        **phases,
        "whole_chain": float(median(map(_whole, runs))),
        "certified_choice": exact["seconds"] if exact["certified"] else np.nan,
    }


def _sizes(runs: list[Figures]) -> Figures:
    return {
        **{name: runs[0][name] for name in ("columns", "with_effect", "rank")},
        "imports": float(median(run["imports_mb"] for run in runs)),
        "robot_loaded": float(median(run["loaded_mb"] for run in runs)),
        "whole_chain": float(median(run["peak_mb"] for run in runs)),
    }


def _ratios(figaroh: list[Figures], loopid: list[Figures]) -> Figures:
    first, other = figaroh[0], loopid[0]
    return {
        "time": median(map(_whole, figaroh)) / median(map(_whole, loopid)),
        "memory": _memory(figaroh) / _memory(loopid),
        "memory_above_imports": _memory(figaroh, "imports_mb") / _memory(loopid, "imports_mb"),
        "same_rank": first["rank"] == other["rank"],
        "residuals_differ_by": abs(first["residual"] / other["residual"] - 1.0),
    }


def _whole(run: Figures) -> float:
    return float(sum(run["seconds"].values()) - run["seconds"]["load"])


def _memory(runs: list[Figures], above: str | None = None) -> float:
    return float(median(run["peak_mb"] - (run[above] if above else 0.0) for run in runs))


if __name__ == "__main__":
    main()
