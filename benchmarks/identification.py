"""Where the time of an identification goes, from the log file to the supported parameters.

    python benchmarks/identification.py [--seconds S] [--json FILE] [ROBOT LOG]

Phases are timed one after the other in one run and set beside a bare loop of Pinocchio's tree
regressor over the same number of samples. Without a log the 3UPS+RPU follows a trajectory in
simulation, 100 samples a second.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
import pinocchio as pin

import loopid
from loopid import FilterOptions, JointTerms, Robot, read_log
from loopid.identification import WeightedLeastSquares
from loopid.identification.fitting import quiet_fit
from loopid.identification.selection import eliminate_parameters
from loopid.motion import Noise, joint_motion, read_motion_program
from tables import show, write_json

RUNS, FILTER = 5, FilterOptions(cutoff=5.0)


def main() -> None:
    """Print the phases and write them on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("robot", nargs="?", default="3ups_rpu")
    parser.add_argument("log", nargs="?")
    parser.add_argument("--seconds", type=float, default=90.0, help="of a simulated log")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # what the log lacks is not the point here
    mechanism = loopid.load(arguments.robot)
    with TemporaryDirectory() as folder:
        log = arguments.log or simulated_log(mechanism, arguments.seconds, Path(folder))
        rows = phases(mechanism, log)
    show(f"identification of {mechanism.name}, medians of {RUNS} runs", rows)
    if arguments.json:
        write_json(arguments.json, {"phases": rows})


def simulated_log(mechanism: Robot, seconds: float, folder: Path) -> str:
    """The first seconds of a trajectory as a CSV."""
    program = read_motion_program(mechanism.name)
    motion = joint_motion(mechanism, program.motion("8", 100.0))
    measured = loopid.simulate(mechanism, motion.select(motion.time <= seconds), Noise(12.0))
    names = [f"{joint}.{what}" for what in ("position", "force") for joint in mechanism.actuated]
    table = np.column_stack([measured.time, measured.position, measured.force])
    file = folder / "run.csv"
    np.savetxt(file, table, delimiter=",", header=",".join(["time", *names]), comments="")
    return str(file)


def phases(mechanism: Robot, path: str) -> list[dict[str, Any]]:
    """Seconds of each phase, and how often a bare regressor loop would fit into it."""
    log = read_log(path, mechanism)
    recording = loopid.prepare(mechanism, log, filter=FILTER)
    model = loopid.force_model(mechanism, "gravity", JointTerms(mechanism.actuated))
    samples = model.samples(recording)
    halves = [model.samples(part) for part in recording.split(0.5)]
    bare = timed(lambda: bare_loop(mechanism, recording.motion.configurations))
    todo: dict[str, Callable[[], object]] = {
        "read and align": lambda: read_log(path, mechanism),
        "filter and assemble": lambda: loopid.prepare(
            mechanism, log, filter=FilterOptions(cutoff=5.0)
        ),
        "base parameters with friction": lambda: loopid.force_model(
            mechanism, "gravity", JointTerms(mechanism.actuated)
        ),
        "regressor": lambda: model.samples(recording),
        "triangular factors": lambda: samples.with_force(samples.force).problem,
        "weighted least squares": lambda: WeightedLeastSquares().fit(samples.problem),
        "with correlated errors": lambda: quiet_fit(samples),
        "elimination": lambda: eliminate_parameters(halves[0], halves[1]),
    }
    rows = [
        {"phase": "bare regressor loop", "samples": len(recording), "seconds": bare, "ratio": 1.0}
    ]
    for name, work in todo.items():
        seconds = timed(work)
        count = len(log) if name == "read and align" else len(recording)
        ratio = seconds / bare
        rows.append({"phase": name, "samples": count, "seconds": seconds, "ratio": ratio})
    return rows


def bare_loop(mechanism: Robot, configurations: np.ndarray) -> None:
    """Nothing but Pinocchio's own call, once a sample."""
    model, zero = mechanism.model, np.zeros(mechanism.model.nv)
    data = model.createData()
    for q in configurations:
        pin.computeJointTorqueRegressor(model, data, q, zero, zero)


def timed(work: Callable[[], object]) -> float:
    """Median of several runs, in s."""
    times = []
    for _ in range(RUNS):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return median(times)


if __name__ == "__main__":
    main()
