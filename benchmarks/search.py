"""All search strategies on the paper's problem, side by side in one run.

    python benchmarks/search.py [--full] [--json FILE]

Times are from the triangular factor of the observation to the base parameters. Exhaustive search
is timed on a sample of the combinations and extrapolated, unless ``--full`` runs all of them.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np

from loopid import Observation, find_base_parameters, load_mechanism
from loopid.base_parameters import ChoiceProblem, ExhaustiveSearch, SubgroupSearch, analyse
from loopid.base_parameters.search.exhaustive import best_in_range
from loopid.regressors import structural_observation
from tables import show, write_json

ROUNDS = 9
ORDERS = 60
SAMPLE = 1 << 18


def main() -> None:
    """Print the comparison and write it on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--full", action="store_true", help="run exhaustive search whole")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    observation = structural_observation(load_mechanism("3ups_rpu"))
    rows = timed_strategies(observation)
    rows.append(exhaustive(observation, rows[0]["condition_number"], arguments.full))
    for row in rows:
        row["ratio"] = row["seconds"] / rows[0]["seconds"]
    orders = subgroup_orders(observation, rows[0]["condition_number"])
    show("search strategies on V2 of the 3UPS+RPU (30 choose 15)", rows)
    show(f"subgroup search over {ORDERS} random column orders", [orders])
    if arguments.json:
        write_json(arguments.json, {"strategies": rows, "subgroup_orders": orders})


def timed_strategies(observation: Observation) -> list[dict[str, Any]]:
    """Median times of the strategies, taken in turn so that drift hits all of them."""
    names = ("exact", "qr", "subgroup")
    times: dict[str, list[float]] = {name: [] for name in names}
    found = {name: find_base_parameters(observation, name) for name in names}
    for _ in range(ROUNDS):
        for name in names:
            start = perf_counter()
            find_base_parameters(observation, name)
            times[name].append(perf_counter() - start)
    return [
        {
            "search": name,
            "condition_number": found[name].search.condition_number,
            "certified": found[name].search.certified,
            "evaluated": found[name].search.evaluated,
            "seconds": median(times[name]),
            "how": f"median of {ROUNDS}",
        }
        for name in names
    ]


def exhaustive(observation: Observation, least: float, full: bool) -> dict[str, Any]:
    """Exhaustive search, whole on all cores or extrapolated from a sample on one."""
    problem = ChoiceProblem(analyse(observation))
    if full:
        result = ExhaustiveSearch().search(problem)
        value, seconds, how = result.condition_number, result.seconds, "whole, on all cores"
    else:
        first = problem.candidates // 3
        start = perf_counter()
        # With the least value known from the start, as it soon is in a whole run.
        best_in_range(problem.vectors, least, (first, first + SAMPLE))
        seconds = (perf_counter() - start) * problem.candidates / SAMPLE
        value, how = float("nan"), f"extrapolated from {SAMPLE:,}, one core"
    return {
        "search": "exhaustive",
        "condition_number": value,
        "certified": full,
        "evaluated": problem.candidates,
        "seconds": seconds,
        "how": how,
    }


def subgroup_orders(observation: Observation, least: float) -> dict[str, Any]:
    """How often subgroup search finds the optimum, something worse, or nothing."""
    generator, structure = np.random.default_rng(0), analyse(observation)
    outcomes = {"optimum": 0, "worse": 0, "nothing": 0}
    worst = 0.0
    for _ in range(ORDERS):
        shuffled = structure.null_basis[generator.permutation(len(structure.columns))]
        result = SubgroupSearch().search(ChoiceProblem(replace(structure, null_basis=shuffled)))
        if not result.found:
            outcomes["nothing"] += 1
            continue
        worst = max(worst, result.condition_number)
        best = result.condition_number <= least * (1 + 1e-9)
        outcomes["optimum" if best else "worse"] += 1
    return outcomes | {"worst_condition_number": worst}


if __name__ == "__main__":
    main()
