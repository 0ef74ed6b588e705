"""Memory and time of an identification by the length of the log, from the file to the intervals.

    python benchmarks/logs.py [--samples N ...] [--jobs N ...] [--formats csv npz parquet h5 bag
                              db3 mcap] [--every] [--json FILE]

A simulated run of the 3UPS+RPU, with friction and noise, is written as a log. A process of its own
reads it, identifies base parameters and friction with their intervals, and says how much memory
it took at most (1 GB is allowed for 1,000,000 samples), and how long. The first row is a process
that imports loopid and finds the base parameters, without a log. By default as many samples are
fitted as the filter's cut-off needs; with --every all of them are.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import h5py
import numpy as np
import polars
from numpy.lib import format as npy
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

import loopid
from loopid import FilterOptions, JointTerms, Robot, read_log
from loopid.identification import fit
from loopid.motion import Noise, joint_motion, read_motion_program
from tables import show, write_json

ROBOT, RATE = "3ups_rpu", 100.0
NOISE = Noise(gaussian=2.0)
FRICTION = np.array([17.0, 300.0, 22.0, 300.0, 19.0, 300.0, 230.0, 2000.0])


def main() -> None:
    """Print the figures and write them on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--samples", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--formats", nargs="+", default=["csv", "npz"], choices=list(WRITERS))
    parser.add_argument("--every", action="store_true", help="fit all samples, not every fourth")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    parser.add_argument("--measure", metavar="LOG", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure is not None:
        print(json.dumps(measured(arguments.measure, arguments.jobs[0], arguments.every)))
        return
    rows = [in_process("", 1, arguments.every) | {"log": "none"}]
    mechanism = loopid.load(ROBOT)
    with TemporaryDirectory() as folder:
        for count in arguments.samples:
            for ending in arguments.formats:
                path = Path(folder) / f"run.{ending}"
                write_log(mechanism, count, path)
                for jobs in arguments.jobs:
                    rows.append(in_process(str(path), jobs, arguments.every) | {"log": ending})
                shutil.rmtree(path) if path.is_dir() else path.unlink()
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
    mechanism = loopid.load(ROBOT)
    model = loopid.force_model(mechanism, "gravity", JointTerms(mechanism.actuated))
    figures: dict[str, Any] = {"log": "", "samples": 0, "fitted": 0, "jobs": jobs}
    times, starts = ("read", "prepare", "regressor", "fit"), [perf_counter()]
    if path:
        log = read_log(path, mechanism)
        starts.append(perf_counter())
        recording = loopid.prepare(mechanism, log, filter=FilterOptions(decimate=not every))
        figures |= {"samples": len(log), "fitted": len(recording)}
        del log
        starts.append(perf_counter())
        samples = model.samples(recording, n_jobs=jobs)
        starts.append(perf_counter())
        result = fit(samples)
        starts.append(perf_counter())
        assert np.isfinite(result.intervals()).all()
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


def write_log(mechanism: Robot, count: int, path: Path) -> None:
    """A log of this many samples: a trajectory over and over, with new noise."""
    names = [f"{joint}.{what}" for what in ("position", "effort") for joint in mechanism.actuated]
    write = WRITERS[path.suffix[1:]]
    write(path, ["time", *names], count, tables(mechanism, count))


def tables(mechanism: Robot, count: int) -> Iterator[np.ndarray]:
    """Blocks of rows: time, positions, forces."""
    motion = joint_motion(mechanism, read_motion_program(mechanism.name).motion("8", RATE))
    terms, done = JointTerms(mechanism.actuated), 0
    measurement = loopid.simulate(mechanism, motion, joint_terms=terms, joint_values=FRICTION)
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
    whole = on_disk(path, len(names), count, blocks)
    with zipfile.ZipFile(path, "w") as archive:
        for name, column in zip(names, whole, strict=True):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                npy.write_array(file, np.asarray(column))
    path.with_suffix(".npy").unlink()


def on_disk(path: Path, width: int, count: int, blocks: Iterator[np.ndarray]) -> np.ndarray:
    """All columns (k, N), in a file beside the log."""
    whole = np.lib.format.open_memmap(path.with_suffix(".npy"), "w+", np.float64, (width, count))
    done = 0
    for block in blocks:
        whole[:, done : done + len(block)] = block.T
        done += len(block)
    return whole


def write_parquet(path: Path, names: list[str], count: int, blocks: Iterator[np.ndarray]) -> None:
    """One table."""
    whole = on_disk(path, len(names), count, blocks)
    polars.DataFrame(dict(zip(names, whole, strict=True))).write_parquet(path)
    path.with_suffix(".npy").unlink()


def write_hdf5(path: Path, names: list[str], count: int, blocks: Iterator[np.ndarray]) -> None:
    """A matrix with named columns, packed."""
    with h5py.File(path, "w") as file:
        table = file.create_dataset("log", (count, len(names)), float, compression="gzip")
        table.attrs["columns"] = names
        done = 0
        for block in blocks:
            table[done : done + len(block)] = block
            done += len(block)


def write_bag(path: Path, names: list[str], count: int, blocks: Iterator[np.ndarray]) -> None:
    """A message a row."""
    store = get_typestore(Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/JointState"
    state, header = store.types[kind], store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"]
    joints = [name.rsplit(".", 1)[0] for name in names[1:5]]
    first = (0,) if path.suffix == ".bag" else ()
    serialize = store.serialize_ros1 if path.suffix == ".bag" else store.serialize_cdr
    with bag_writer(path) as writer:
        topic = writer.add_connection("/joint_states", kind, typestore=store)
        for block in blocks:
            for row in block:
                time = round(row[0] * 1e9)
                head = header(*first, stamp(*divmod(time, 10**9)), "")
                message = state(head, joints, row[1:5], np.empty(0), row[5:])
                writer.write(topic, time, serialize(message, kind))


def bag_writer(path: Path) -> Any:
    """A bag of ROS 1, or of ROS 2 as its ending says."""
    if path.suffix == ".bag":
        return Ros1Writer(path)
    storage = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    return Ros2Writer(path, version=9, storage_plugin=storage)


WRITERS: dict[str, Callable[[Path, list[str], int, Iterator[np.ndarray]], None]] = {
    "csv": write_csv,
    "npz": write_npz,
    "parquet": write_parquet,
    "h5": write_hdf5,
    "bag": write_bag,
    "db3": write_bag,
    "mcap": write_bag,
}


if __name__ == "__main__":
    main()
