"""Which choices of base parameters are proven best, and how close the others are.

    python benchmarks/certificates.py [--time-limit S] [--criterion nullspace|regressor]
                                      [--only PATTERN] [--jobs N] [--json FILE]

Every URDF of example-robot-data, with a fixed and with a floating base, and every bundled
mechanism, full and at rest. Seconds are those of the search alone, on one BLAS thread.
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from fnmatch import fnmatch
from math import log10, nan
from multiprocessing import get_context
from typing import Any

import numpy as np

import loopid
from example_robots import distinct_urdfs
from loopid import LoopidError, bundled_robots
from loopid.base_parameters import (
    ChoiceProblem,
    ExactSearch,
    SearchOptions,
    SearchResult,
    Structure,
)
from loopid.base_parameters.choice import CRITERIA
from loopid.base_parameters.structure import analyse, independent_blocks
from loopid.regressors import structural_observation
from tables import show, write_json

GROUPS = {
    "fixed": ("fixed",),
    "floating": ("floating",),
    "fixed and floating": ("fixed", "floating"),
    "full": ("full",),
    "gravity": ("gravity",),
}
THREADS = "OPENBLAS_NUM_THREADS"
SOON = 10.0  # s, the default time limit of exact search


@dataclass(frozen=True)
class Case:
    """One problem: a robot file, with its base fixed or floating, or a mechanism's model."""

    name: str
    group: str
    path: str
    time_limit: float
    criterion: str

    @property
    def model(self) -> str:
        """Columns of the regressor."""
        return "gravity" if self.group == "gravity" else "full"


def main() -> None:
    """Print the table, the refusals and the summary, and write them on request."""
    arguments = _arguments()
    every = cases(arguments.time_limit, arguments.criterion)
    wanted = [case for case in every if fnmatch(case.name, arguments.only)]
    if not wanted:
        raise SystemExit(f"no robot is called {arguments.only}")
    rows = list(_reported(results(wanted, arguments.jobs), len(wanted)))
    solved = [row for row in rows if "refused" not in row]
    refused = [row for row in rows if "refused" in row]
    summary = [_summary(group, solved, refused) for group in GROUPS]
    summary = [row for row in summary if row["robots"] or row["refused"]]
    title = f"exact search, {arguments.criterion}, {arguments.time_limit:g} s at most"
    for heading, table in ((title, solved), ("refused", refused), ("summary", summary)):
        if table:
            show(heading, table)
    if arguments.json:
        write_json(arguments.json, {"solved": solved, "refused": refused, "summary": summary})


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="S", help="a search")
    parser.add_argument("--criterion", choices=CRITERIA, default=CRITERIA[0])
    parser.add_argument("--only", default="*", metavar="PATTERN", help="names, such as 'talos*'")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="searches at once")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    return parser.parse_args()


def cases(time_limit: float, criterion: str) -> list[Case]:
    """All problems: mechanisms with loops, then others' robots from small to large."""
    files = [(name, group, name) for name in bundled_robots() for group in ("full", "gravity")]
    for name, urdf in distinct_urdfs().items():
        files += [(name, group, str(urdf)) for group in ("fixed", "floating")]
    return [Case(*file, time_limit, criterion) for file in files]


def results(wanted: list[Case], jobs: int) -> Iterator[dict[str, Any]]:
    """Rows in the order of the cases, from worker processes with one BLAS thread each."""
    os.environ[THREADS] = "1"  # read by the workers when they import NumPy
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        yield from pool.map(solve, wanted)


def solve(case: Case) -> dict[str, Any]:
    """One row; a robot that is refused has a reason instead of figures."""
    warnings.simplefilter("ignore")  # of URDFs that are what they are
    try:
        mechanism = loopid.load(case.path, floating_base=case.group == "floating")
        structure = analyse(structural_observation(mechanism, case.model))
    except LoopidError as error:
        reason, _, _ = str(error).removeprefix(f"{case.path}: ").partition(": choose")
        return {"name": case.name, "group": case.group, "refused": reason}
    problem = ChoiceProblem(structure, case.criterion)
    result = ExactSearch(SearchOptions(time_limit=case.time_limit)).search(problem)
    return {"name": case.name, "group": case.group, **_figures(structure, result)}


def _figures(structure: Structure, result: SearchResult) -> dict[str, Any]:
    blocks = [(len(block), dependent) for block, dependent in _blocks(structure) if dependent]
    largest, chosen = max(blocks, default=(0, 0))
    return {
        "n": len(structure.columns),
        "rank": structure.rank,
        "blocks": len(blocks),
        "largest_block": f"{largest} choose {chosen}",
        "log10_combinations": log10(result.candidates),
        "condition_number": result.condition_number,
        "certified": result.certified,
        "reason": result.reason,
        "gap": result.gap,
        "nodes": result.nodes,
        "seconds": result.seconds,
    }


def _blocks(structure: Structure) -> Iterator[tuple[np.ndarray, int]]:
    """Columns of each block, and how many of them become dependent."""
    for block in independent_blocks(structure.null_basis):
        # The trace of a projector's diagonal block is the dimension of its part.
        yield block, round(float((structure.null_basis[block] ** 2).sum()))


def _reported(rows: Iterable[dict[str, Any]], total: int) -> Iterator[dict[str, Any]]:
    for number, row in enumerate(rows, start=1):
        how = "refused" if "refused" in row else f"{row['seconds']:.2f} s, gap {row['gap']:.4g}"
        print(f"{number}/{total} {row['name']} {row['group']}: {how}", flush=True)
        yield row


def _summary(
    group: str, solved: list[dict[str, Any]], refused: list[dict[str, Any]]
) -> dict[str, Any]:
    rows = [row for row in solved if row["group"] in GROUPS[group]]
    certified = sum(row["certified"] for row in rows)
    return {
        "group": group,
        "robots": len(rows),
        f"certified_in_{SOON:g}_s": sum(
            row["certified"] and row["seconds"] <= SOON for row in rows
        ),
        "certified": certified,
        "percent": 100.0 * certified / len(rows) if rows else nan,
        "worst_gap": max((row["gap"] for row in rows), default=nan),
        "slowest_certificate_s": max((r["seconds"] for r in rows if r["certified"]), default=nan),
        "refused": sum(row["group"] in GROUPS[group] for row in refused),
    }


if __name__ == "__main__":
    main()
