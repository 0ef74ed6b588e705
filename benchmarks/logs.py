"""Memory and time of an identification by the length of the log, from the file to the intervals.

    python benchmarks/logs.py [--samples N ...] [--jobs N ...] [--formats csv npz] [--every]
                              [--json FILE]

A simulated run of the 3UPS+RPU, with friction and noise, is written as a log. A process of its own
reads it, identifies base parameters and friction with their intervals, and tells how much memory
it took at most, and how long. The first row is a process that imports loopid and finds the base
parameters, without a log. By default every fourth sample is fitted, as the filter's cut-off asks
for; with --every all of them are.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
from numpy.lib import format as npy

from loopid import (
    JointTerms,
    Mechanism,
    Noise,
    find_force_model,
    fit,
    joint_motion,
    load_mechanism,
    prepare_recording,
    read_log,
    read_motion_program,
    simulate_measurement,
)
from tables import show, write_json

ROBOT, RATE = "3ups_rpu", 100.0
NOISE = Noise(gaussian=2.0)
FRICTION = np.array([17.0, 300.0, 22.0, 300.0, 19.0, 300.0, 230.0, 2000.0])


def main() -> None:
    """Print the figures and write them on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--samples", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--formats", nargs="+", default=["csv", "npz"])
    parser.add_argument("--every", action="store_true", help="fit all samples, not every fourth")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    parser.add_argument("--measure", metavar="LOG", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure is not None:
        print(json.dumps(measured(arguments.measure, arguments.jobs[0], arguments.every)))
        return
    rows = [in_process("", 1, arguments.every) | {"log": "none"}]
    mechanism = load_mechanism(ROBOT)
    with TemporaryDirectory() as folder:
        for count in arguments.samples:
            for ending in arguments.formats:
                path = Path(folder) / f"run.{ending}"
                write_log(mechanism, count, path)
                for jobs in arguments.jobs:
                    rows.append(in_process(str(path), jobs, arguments.every) | {"log": ending})
                path.unlink()
    show(f"identification of {mechanism.name} from logs", rows)
    if arguments.json:
        write_json(arguments.json, {"logs": rows})


def in_process(path: str, jobs: int, every: bool) -> dict[str, Any]:
    """Figures of one identification in a process of its own."""
    options = ["--measure", path, "--jobs", str(jobs), *(["--every"] if every else [])]
    command = [sys.executable, "-W", "ignore", __file__, *options]
    return dict(json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout))


def measured(path: str, jobs: int, every: bool) -> dict[str, Any]:
    """Identify, and tell seconds and megabytes."""
    mechanism = load_mechanism(ROBOT)
    model = find_force_model(mechanism, "gravity", JointTerms(mechanism.actuated))
    figures: dict[str, Any] = {"log": "", "samples": 0, "fitted": 0, "jobs": jobs}
    times, starts = ("read", "prepare", "regressor", "fit"), [perf_counter()]
    if path:
        log = read_log(path, mechanism)
        starts.append(perf_counter())
        recording = prepare_recording(mechanism, log, decimate=not every)
        starts.append(perf_counter())
        samples = model.samples(recording, jobs)
        starts.append(perf_counter())
        result = fit(samples)
        starts.append(perf_counter())
        assert np.isfinite(result.intervals()).all()
        figures |= {"samples": len(log), "fitted": len(recording)}
    figures |= {f"{name}_s": 0.0 for name in times}
    figures |= {f"{n}_s": b - a for n, a, b in zip(times, starts, starts[1:], strict=False)}
    workers = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    return figures | {"peak_MB": peak_megabytes(), "worker_peak_MB": workers}


def peak_megabytes() -> float:
    """Largest resident memory of this process so far.

    The usual ``ru_maxrss`` also counts what the process that started this one had in memory then.
    """
    status = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM"))


def write_log(mechanism: Mechanism, count: int, path: Path) -> None:
    """A log of so many samples: a trajectory over and over, with new noise."""
    names = [f"{joint}.{what}" for what in ("position", "force") for joint in mechanism.actuated]
    write = write_csv if path.suffix == ".csv" else write_npz
    write(path, ["time", *names], count, tables(mechanism, count))


def tables(mechanism: Mechanism, count: int) -> Iterator[np.ndarray]:
    """Blocks of rows: time, positions, forces."""
    motion = joint_motion(mechanism, read_motion_program(mechanism.name).motion("8", RATE))
    terms, done = JointTerms(mechanism.actuated), 0
    measurement = simulate_measurement(mechanism, motion, joint_terms=terms, joint_values=FRICTION)
    there = np.column_stack([measurement.position, measurement.force])
    generator = np.random.default_rng(0)
    while done < count:
        block = there[: count - done].copy()
        block[:, 4:] += generator.normal(scale=NOISE.gaussian, size=(len(block), 4))
        yield np.column_stack([(done + np.arange(len(block))) / RATE, block])
        done += len(block)


def write_csv(path: Path, names: list[str], count: int, blocks: Iterator[np.ndarray]) -> None:
    """Text, a block of rows at a time."""
    with path.open("w") as file:
        file.write(",".join(names) + "\n")
        for block in blocks:
            np.savetxt(file, block, delimiter=",", fmt="%.9g")


def write_npz(path: Path, names: list[str], count: int, blocks: Iterator[np.ndarray]) -> None:
    """One array a column, by way of a matrix on the disk."""
    whole = np.lib.format.open_memmap(
        path.with_suffix(".npy"), "w+", np.float64, (len(names), count)
    )
    done = 0
    for block in blocks:
        whole[:, done : done + len(block)] = block.T
        done += len(block)
    with zipfile.ZipFile(path, "w") as archive:
        for name, column in zip(names, whole, strict=True):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                npy.write_array(file, np.asarray(column))
    path.with_suffix(".npy").unlink()


if __name__ == "__main__":
    main()
