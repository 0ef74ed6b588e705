"""What an observation costs beside a bare loop of Pinocchio's regressor over the same samples.

    python benchmarks/observation.py [--samples N | --single] [--json FILE]

One core; microseconds of processor time per sample, the least of rounds in which all phases take
turns. The bare loop asks Pinocchio for the regressor Y of each sample and keeps it. The regressor
K = Gᵀ Y of the closed loops takes

- jacobian: poses of the closures' frames, Jacobians of the joints, and A from both,
- projection: G, and where the model is full also velocities, drift and accelerations,
- columns: Y of every sample, projected;

the triangular factor of the stacked columns comes on top. The last table follows measured
strokes along a smooth trajectory of 10 s at 1 kHz, each from the one before (assembly).

With ``--single`` a controller's questions, one sample at a time: the gravity regressor of a pose,
and from measured strokes, warm-started a millisecond before, the forces that hold the robot.
"""

from __future__ import annotations

import argparse
import os

import loopid

os.environ["OPENBLAS_NUM_THREADS"] = "1"

from collections.abc import Callable
from math import nan
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pinocchio as pin

from example_robots import robots_folder
from loopid import Dynamics, random_configurations
from loopid.kinematics import (
    assemble,
    closed_motion,
    constraint_jacobian,
    measured_coordinates,
    project,
    random_motions,
)
from loopid.observation import Observation
from loopid.regressors import gravity_regressor, motion_regressor
from loopid.robot import Robot
from tables import show, write_json

ROUNDS = 15
DURATION, RATE = 10, 1000  # s and Hz, of the trajectory that is assembled
TRAJECTORY = DURATION * RATE
SWING = 0.01  # characteristic lengths
BARS = {("3ups_rpu", "gravity"): 3.0, ("3ups_rpu", "full"): 4.0}
ASSEMBLY_BAR = 8.0
SINGLE = 200  # samples that are asked for one at a time
SINGLE_BARS = {("3ups_rpu", "gravity"): 25.0, ("3ups_rpu", "assembly + forces"): 80.0}


def main() -> None:
    """Print the tables and write them on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--samples", type=int, default=4000, help="samples of an observation")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    parser.add_argument("--single", action="store_true", help="one sample at a time")
    arguments = parser.parse_args()
    if arguments.single:
        rows = [single(name, loopid.load(name)) for name in ("3ups_rpu", "6ups")]
        show("one sample at a time, µs", rows)
        if arguments.json:
            write_json(arguments.json, {"single": rows})
        return
    robots = {name: loopid.load(name) for name in ("3ups_rpu", "6ups")}
    ur10 = loopid.load(str(Path(robots_folder()) / "ur_description/urdf/ur10_robot.urdf"))
    observations = [
        observation(name, robot, model, arguments.samples)
        for name, robot in {**robots, "ur10": ur10}.items()
        for model in ("gravity", "full")
    ]
    assemblies = [assembly(name, robot) for name, robot in robots.items()]
    show("observation, µs per sample", observations)
    title = f"assembly of {TRAJECTORY:,} samples at {RATE:,} Hz along a trajectory, µs per sample"
    show(title, assemblies)
    if arguments.json:
        write_json(arguments.json, {"observation": observations, "assembly": assemblies})


def observation(name: str, robot: Robot, model: str, count: int) -> dict[str, Any]:
    """Costs of the phases of one model's observation."""
    q = random_configurations(robot, count, seed=0)
    rates = random_motions(robot, count, seed=0)
    motion = closed_motion(robot, q, *rates)
    v, a = motion.velocities, motion.accelerations
    still = np.zeros_like(v)

    def regressor() -> np.ndarray:
        if model == "gravity":
            return gravity_regressor(robot, q)
        return motion_regressor(robot, closed_motion(robot, q, rates[0], rates[1]))

    columns, parameters = regressor(), robot.parameters(model)
    resting = model == "gravity"
    taken = least(
        {
            "bare": bare(robot, q, still if resting else v, still if resting else a),
            "jacobian": lambda: constraint_jacobian(robot, q),
            "projected": lambda: project(robot, q) if resting else closed_motion(robot, q, *rates),
            "regressor": regressor,
            "factor": lambda: Observation.from_matrix(columns, parameters),
        },
        count,
    )
    return {
        "robot": name,
        "model": model,
        "rows_x_columns": f"{columns.shape[1]} x {columns.shape[2]}",
        "bare": taken["bare"],
        "jacobian": taken["jacobian"],
        "projection": max(taken["projected"] - taken["jacobian"], 0.0),
        "columns": max(taken["regressor"] - taken["projected"], 0.0),
        "regressor": taken["regressor"],
        "regressor / bare": taken["regressor"] / taken["bare"],
        "bar": BARS.get((name, model), float("nan")),
        "factor": taken["factor"],
    }


def assembly(name: str, robot: Robot) -> dict[str, Any]:
    """Costs of closing the loops for strokes along a smooth trajectory."""
    strokes = smooth_strokes(robot)
    found = assemble(robot, strokes, trajectory=True)
    still = np.zeros((len(found), robot.model.nv))
    taken = least(
        {
            "bare": bare(robot, found, still, still),
            "assembly": lambda: assemble(robot, strokes, trajectory=True),
        },
        len(found),
        rounds=7,
    )
    ratio = taken["assembly"] / taken["bare"]
    return {"robot": name, **taken, "assembly / bare": ratio, "bar": ASSEMBLY_BAR}


def single(name: str, robot: Robot) -> dict[str, Any]:
    """Costs of one sample at a time, along a trajectory at 1 kHz."""
    dynamics, strokes = Dynamics(robot), smooth_strokes(robot)[:SINGLE]
    poses = dynamics.assemble(strokes, trajectory=True)
    still = np.zeros_like(poses)

    def gravity() -> None:
        for q in poses:
            gravity_regressor(robot, q)

    def assembly_and_forces() -> None:
        for stroke in strokes[1:]:
            dynamics.gravity(stroke)

    phases: dict[str, Callable[[], object]] = {
        "bare": bare(robot, poses, still, still),
        "gravity": gravity,
        "assembly + forces": assembly_and_forces,
    }
    taken = least(phases, len(poses), rounds=25)
    ratios = {phase: taken[phase] / taken["bare"] for phase in list(taken)[1:]}
    row: dict[str, Any] = {"robot": name, **taken}
    for phase, ratio in ratios.items():
        row |= {f"{phase} / bare": ratio, f"bar of {phase}": SINGLE_BARS.get((name, phase), nan)}
    return row


def smooth_strokes(robot: Robot) -> np.ndarray:
    """Measured coordinates (N, m) that swing about the reference, the k-th one k times in all."""
    start = measured_coordinates(robot).read(robot.reference[None])[0]
    phase = 2 * np.pi * np.linspace(0, 1, TRAJECTORY)[:, None]
    swing = np.sin(phase * np.arange(1, len(start) + 1))
    return np.asarray(start + SWING * robot.length * swing)


def bare(robot: Robot, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> Callable[[], None]:
    """Pinocchio's regressors of all samples, kept in an array that is there already."""
    model, data = robot.model, robot.model.createData()
    Y = np.zeros((len(q), model.nv, 10 * (model.njoints - 1)))

    def run() -> None:
        for k in range(len(q)):
            Y[k] = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])

    return run


def least(
    phases: dict[str, Callable[[], object]], count: int, rounds: int = ROUNDS
) -> dict[str, float]:
    """Processor time per sample of each phase in µs, taken in turn so that drift hits all."""
    times: dict[str, list[float]] = {name: [] for name in phases}
    for _ in range(rounds):
        for name, phase in phases.items():
            start = process_time()
            phase()
            times[name].append((process_time() - start) / count * 1e6)
    return {name: min(values) for name, values in times.items()}


if __name__ == "__main__":
    main()
