"""All search strategies on the paper's problem, side by side in one run.

    python benchmarks/search.py [--full] [--json FILE]

Times are from the triangular factor of the observation to the choice. Exhaustive search
is timed on a sample of the combinations and extrapolated, unless ``--full`` runs all of them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations, islice
from statistics import median
from time import process_time
from typing import Any

import numpy as np

import loopid
from loopid.arguments import FloatArray, IntArray
from loopid.base_parameters import ChoiceProblem, ExactSearch, PivotedQR, SubgroupSearch
from loopid.base_parameters.choice import condition_numbers
from loopid.base_parameters.structure import analyse
from loopid.observation import Observation
from loopid.regressors import structural_observation
from tables import show, write_json

ROUNDS = 9
# Random poses, random orders of the columns at the first poses, and at each of the others.
SEEDS, ORDERS, ORDERS_BESIDE = 20, 60, 1
SAMPLE, CHUNK = 1 << 18, 1 << 14
DETERMINANT_SLACK, TIED = 1e-6, 1e-9  # relative: round-off of a determinant, and of ties


def main() -> None:
    """Print the comparison and write it on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--full", action="store_true", help="run exhaustive search whole")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    observation = structural_observation(loopid.load("3ups_rpu"))
    rows = timed_strategies(observation)
    rows.append(exhaustive(observation, rows[0]["condition_number"], arguments.full))
    for row in rows:
        row["ratio"] = row["seconds"] / rows[0]["seconds"]
    least = rows[0]["condition_number"]
    outcomes = [subgroup_outcomes("3ups_rpu", least, name) for name in ("gap", "pseudocode")]
    show("search strategies on V2 of the 3UPS+RPU (30 choose 15)", rows)
    show(f"subgroup search, {SEEDS} pose seeds and {ORDERS} column orders", outcomes)
    if arguments.json:
        write_json(arguments.json, {"strategies": rows, "subgroup_outcomes": outcomes})


def timed_strategies(observation: Observation) -> list[dict[str, Any]]:
    """Median times of the strategies, taken in turn so that drift hits all of them."""
    strategies = {
        "exact": ExactSearch(),
        "qr": PivotedQR(),
        "subgroup": SubgroupSearch(),
        "subgroup, pseudocode": SubgroupSearch(variant="pseudocode"),
    }
    times: dict[str, list[float]] = {name: [] for name in strategies}
    found = {}
    for _ in range(ROUNDS):
        for name, strategy in strategies.items():
            start = process_time()
            # A search that finds nothing is timed as well.
            found[name] = strategy.search(ChoiceProblem(analyse(observation)))
            times[name].append(process_time() - start)
    return [
        {
            "search": name,
            "condition_number": result.condition_number,
            "certified": result.certified,
            "evaluated": result.evaluated,
            "ties": result.ties,
            "seconds": median(times[name]),
            "how": f"median of {ROUNDS}, the first {1e3 * times[name][0]:.3g} ms",
        }
        for name, result in found.items()
    ]


def promising(vectors: FloatArray, selections: IntArray, most: float) -> FloatArray:
    """Condition numbers of those selections (c, k) that may reach one, by their determinants.

    With all singular values between σ / κ and σ, |det| >= σ^k / κ^(k-1), and σ is at least their
    root mean square. A determinant costs a fifth of the singular values.
    """
    matrices, count = vectors[selections], selections.shape[1]
    mean = np.sqrt((vectors**2).sum(axis=1)[selections].sum(axis=1) / count)
    enough = mean * (mean / most) ** (count - 1) * (1 - DETERMINANT_SLACK)
    return condition_numbers(matrices[np.abs(np.linalg.det(matrices)) >= enough])


def exhaustive(observation: Observation, least: float, full: bool) -> dict[str, Any]:
    """All combinations [Gautier1991], or a sample of them, extrapolated."""
    problem = ChoiceProblem(analyse(observation))
    vectors, (n, count) = problem.vectors, problem.vectors.shape
    if full:
        every = combinations(range(n), count)
        parts = iter(lambda: [*islice(every, CHUNK)], [])
        chunks: Iterable[IntArray] = (np.array(part) for part in parts)
        best, ties, how = np.inf, 0, "whole"
    else:
        # With the least value known from the start, as it soon is in a whole run.
        places = np.argsort(np.random.default_rng(0).random((SAMPLE, n)), axis=1)[:, :count]
        chunks, best, ties = np.split(places, SAMPLE // CHUNK), least, 0
        how = f"extrapolated from {SAMPLE:,}"
    start = process_time()
    for selections in chunks:
        found = promising(vectors, selections, best * (1 + TIED))
        lowest = float(found.min(initial=np.inf))
        ties = ties if lowest > best / (1 + TIED) else 0
        best = min(best, lowest)
        ties += int((found <= best * (1 + TIED)).sum())
    seconds = process_time() - start
    return {
        "search": "exhaustive",
        "condition_number": best if full else float("nan"),
        "certified": full,
        "evaluated": problem.candidates,
        "ties": ties if full else None,
        "seconds": seconds if full else seconds * problem.candidates / SAMPLE,
        "how": how,
    }


def subgroup_outcomes(robot: str, least: float, variant: str) -> dict[str, Any]:
    """How often subgroup search finds the optimum, something worse, or nothing.

    Over random poses, and for each over random orders of the columns.
    """
    outcomes, worst = {"optimum": 0, "worse": 0, "nothing": 0}, 0.0
    search, mechanism = SubgroupSearch(variant=variant), loopid.load(robot)
    for seed in range(SEEDS):
        structure = analyse(structural_observation(mechanism, seed=seed))
        orders = ORDERS if seed == 0 else ORDERS_BESIDE
        generator = np.random.default_rng(seed)
        for order in range(orders):
            rows = np.arange(len(structure.columns)) if order == 0 else None
            rows = generator.permutation(len(structure.columns)) if rows is None else rows
            shuffled = replace(structure, null_basis=structure.null_basis[rows])
            result = search.search(ChoiceProblem(shuffled))
            if not result.found:
                outcomes["nothing"] += 1
                continue
            worst = max(worst, result.condition_number)
            best = result.condition_number <= least * (1 + 1e-9)
            outcomes["optimum" if best else "worse"] += 1
    return {"variant": variant} | outcomes | {"worst_condition_number": worst}


if __name__ == "__main__":
    main()
