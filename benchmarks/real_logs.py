"""Logs of real robots: each is fitted by default, judges every other fit, and fits are compared.

    python benchmarks/real_logs.py DIR [--robot FILE] [--only LOG...] [--model full] [--terms TERMS]
                                   [--jobs N] [--json FILE]

DIR holds a robot file and its logs (CSV, gzip too); a ``mapping.yaml`` is of all of them. Without
``--robot`` the YAML that names a robot, or else the URDF, is taken. Printed are

- errors of each fit on each other log, motor by motor, in % of the motor's force where it moves, in
  the root mean square; beside them those by ``--terms Fc,Fv,Fo,Ia`` and, from ``published.json``
  in DIR (a list of {"fit", "judge", "errors", "source"}), those that others have published;
- for each pair of fits how many of the differences between their base parameters are *usual*, below
  1.96 joint standard errors, 95 % where intervals hold, and the largest.
"""

from __future__ import annotations

import argparse
import json
import warnings
from itertools import combinations, permutations
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

import loopid
from loopid import LoopidError, identify, read_log
from loopid.arguments import FloatArray
from loopid.diagnosis import compare_fits
from loopid.identification import Fit
from loopid.logs import Recording
from loopid.robot import Robot
from tables import show, write_json

PLAIN = "Fc,Fv,Fo,Ia"
LOGS = (".csv", ".csv.gz", ".npz", ".parquet")


def robot_of(folder: Path) -> Robot:
    """The robot of a folder: of its YAMLs the first that is one, or else its URDF."""
    for file in [*sorted(folder.glob("*.yaml")), *sorted(folder.glob("*.urdf"))]:
        try:
            return loopid.load(file)
        except LoopidError:
            continue  # a mapping, or another file
    raise SystemExit(f"{folder} holds no robot: give one by --robot")


def recordings(folder: Path, robot: Robot, only: list[str]) -> dict[str, Recording]:
    """All logs of a folder that are logs of its robot, by the first part of their names."""
    mapping = folder / "mapping.yaml"
    found = {}
    for file in sorted(folder.iterdir()):
        name = file.name.split(".")[0]
        if file.name.endswith(LOGS) and (not only or name in only):
            log = read_log(file, robot, mapping=mapping if mapping.exists() else None)
            found[name] = loopid.prepare(robot, log)
    return found


def fitted(robot: Robot, run: Recording, model: str, terms: str) -> Fit:
    """The recommended fit of a log."""
    warnings.simplefilter("ignore")
    return identify(loopid.force_model(robot, model, terms), [run]).fit


def errors(fit: Fit, run: Recording) -> FloatArray:
    """Of each motor's force where it moves, in % of it."""
    found = fit.predict(run)
    used, force = found.recording.used, found.recording.force
    with np.errstate(divide="ignore", invalid="ignore"):
        sizes = np.sqrt((np.where(used, force, 0.0) ** 2).sum(axis=0) / used.sum(axis=0))
        return np.asarray(100 * found.moving.residual_rms / sizes)


def published(folder: Path) -> list[dict[str, Any]]:
    """Errors that others have published for the logs of a folder."""
    file = folder / "published.json"
    return json.loads(file.read_text()) if file.exists() else []


def main() -> None:
    """Print two tables, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--robot", help="robot file, where the folder has several or none")
    parser.add_argument("--only", nargs="+", default=[], metavar="LOG", help="these logs alone")
    parser.add_argument("--model", choices=("full", "gravity"), default="full")
    parser.add_argument("--terms", default="auto")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    folder = arguments.folder
    robot = loopid.load(arguments.robot) if arguments.robot else robot_of(folder)
    runs = recordings(folder, robot, arguments.only)
    if len(runs) < 2:
        raise SystemExit(f"two logs or more are compared, not {len(runs)}")
    choices = dict.fromkeys((arguments.terms, PLAIN))
    jobs = [(name, terms) for name in runs for terms in choices]
    found = Parallel(arguments.jobs)(
        delayed(fitted)(robot, runs[name], arguments.model, terms) for name, terms in jobs
    )
    fits = dict(zip(jobs, found, strict=True))
    motors = robot.independent
    judged = []
    for (one, other), terms in [(pair, t) for pair in permutations(runs, 2) for t in choices]:
        each = errors(fits[one, terms], runs[other])
        row = {"fit of": one, "judged on": other, "by": terms}
        judged.append(row | {name: float(x) for name, x in zip(motors, each, strict=True)})
    for given in published(folder):
        row = {"fit of": given["fit"], "judged on": given["judge"], "by": given["source"]}
        judged.append(row | dict(zip(motors, map(float, given["errors"]), strict=True)))
    judged.sort(key=lambda row: (row["fit of"], row["judged on"]))
    show("errors where motors move, in % of each motor's force", judged)
    pairs = []
    for (one, other), terms in [(pair, t) for pair in combinations(runs, 2) for t in choices]:
        two = compare_fits(fits[one, terms], fits[other, terms])
        worst = two.expressions[int(two.apart.argmax())] if two.expressions else "-"
        numbers = {"differences": len(two.expressions), "usual %": 100 * two.usual}
        row = {"fits of": f"{one}, {other}", "terms": terms} | numbers
        pairs.append(row | {"largest": float(two.apart.max(initial=0.0)), "of": worst})
    show("differences of base parameters in joint standard errors", pairs)
    if arguments.json:
        write_json(arguments.json, {"errors": judged, "agreement": pairs})


if __name__ == "__main__":
    main()
