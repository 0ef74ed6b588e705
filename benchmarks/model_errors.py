"""What verdicts and intervals say of robots with forces that loopid does not model: a Monte Carlo.

    python benchmarks/model_errors.py [--runs N] [--seed N] [--robot NAME ...] [--case NAME ...]

Plants of MuJoCo follow a motion; the fit of its log is judged by the truth and by another motion:
in how many runs the verdict says "as parameters of the robot", a force is named as missing, or any
warning is given, how many 95 % intervals of bodies hold the truth, how many new forces are in the
band, and in how many runs the verdict's error is at least that on the other motion, or half of it.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

import loopid
from loopid import identify
from loopid.identification.verdict import PARAMETERS
from loopid.parameters import KINDS
from loopid.workers import one_blas_thread
from plants import DRIVES, Plant, Sensors
from tables import show, write_json

CASES: dict[str, dict[str, float]] = {
    "clean": {},
    "noise 5 %": {},
    "repeated": {},
    "cogging": {"cogging": 0.3},
    "load": {"load": 0.1},
    "drift": {"drift": 0.2},
    "bent": {"bend": 1.0},
    "Stribeck": {"stribeck": 0.3},
    "Stribeck left out": {"stribeck": 0.3},
    "spring": {"spring": 2.0},
    "weak spring": {"spring": 0.5},
    "bristles": {"bristle": 0.002},
    "length": {"length": 0.02},
}
# Joint terms by name; elsewhere the default.
TERMS = {"Stribeck left out": "Fc,Fv"}


def judged(name: str, case: str, seed: int) -> dict[str, float]:
    """What is said of one run, and what is true."""
    plant = Plant(name=name, seed=seed, **CASES[case])  # type: ignore[arg-type]
    sensors = Sensors(noise=0.05 if case == "noise 5 %" else 0.01)
    pace = "repeated" if case == "repeated" else "fast"
    log = plant.follow(plant.motion(pace)).log(sensors, seed)
    other = replace(plant, seed=seed + 500).motion("fast")
    new = plant.follow(other).log(sensors, seed + 500)
    model = loopid.force_model(plant.robot, "full", TERMS.get(case, "auto"))
    found = identify(model, [loopid.prepare(plant.robot, log)])
    truth, fit = plant.values(found.force_model.base), found.fit
    bodies = [
        j
        for j, parameter in enumerate(fit.parameters)
        if parameter.kind in KINDS and fit.parameters.names[j] not in fit.assumed
    ]
    low, high = fit.intervals()[bodies].T
    prediction = fit.predict(loopid.prepare(plant.robot, new))
    error, inside = float(np.nanmax(prediction.relative_errors)), prediction.inside
    said = [each.title for each in found.findings if each.severity != "note"]
    return {
        "as parameters": float(PARAMETERS in str(found.verdict)),
        "missing": float(any(each.certainty == "clear" for each in found.missing)),
        "warned": float(bool(said)),
        "repeats": float(any("repeats" in each for each in said)),
        "bodies hold": float(((low <= truth[bodies]) & (truth[bodies] <= high)).mean()),
        "band holds": float("nan") if inside is None else float(np.nanmin(inside)),
        "claim holds": float(found.verdict.error >= error),
        "half of it": float(2 * found.verdict.error >= error),
    }


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=20, help="of each robot and case")
    parser.add_argument("--seed", type=int, default=0, help="of the first run")
    parser.add_argument("--robot", choices=list(DRIVES), nargs="+", default=["five_bar", "ur5"])
    parser.add_argument("--case", choices=list(CASES), nargs="+", default=list(CASES))
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows: list[dict[str, Any]] = []
    for name in arguments.robot:
        for case in arguments.case:
            seeds = range(arguments.seed, arguments.seed + arguments.runs)
            with one_blas_thread():
                every = [judged(name, case, seed) for seed in seeds]
            means = {what: float(np.mean([each[what] for each in every])) for what in every[0]}
            rows.append({"robot": name, "case": case, **means})
    show(f"errors of models, {arguments.runs} runs a row", rows)
    if arguments.json:
        write_json(arguments.json, {"errors": rows})


if __name__ == "__main__":
    main()
