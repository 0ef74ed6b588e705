"""Generated C: a sample of a control loop in µs, agreement with Python, motions that close.

    python benchmarks/codegen.py [--motions N] [--json FILE] [ROBOT ...]

Drive inertia and friction of all motors are in the models. All motors move by 0.2 mm or mrad
from random closed poses and back: assembly in two Newton steps, then forces; compiled with -O2, in
a loop of C, the least processor time of some runs. Beside it Python, one sample after the other.

Then N random motions each, of ways of some length with 1, 2 and 3 Newton steps: how many are
refused, and how many that are not end elsewhere than Python's assembly, which follows the whole
way.
"""

from __future__ import annotations

import argparse
import ctypes
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

import numpy as np

import loopid
from compiled_c import NUMBERS, CompiledRobot
from example_robots import robots_folder
from loopid import JointTerms, random_configurations
from loopid.export import c_source
from loopid.export.c_code import motor_positions
from loopid.identification import ForceModel
from loopid.kinematics import assemble
from loopid.kinematics.assembly import try_assemble
from loopid.workers import one_blas_thread
from tables import show, write_json

ROBOTS = ("five_bar", "3ups_rpu", "delta", "6ups", "UR10")
MODELS = ("gravity", "full")
WAY = 2e-4  # m or rad
POSES, ONE_BY_ONE, REPEATS, RUNS = 200, 30, 20, 15
WAYS = 1e-5, 1e-3, 1e-2  # of the motors, in m or rad
PLACES = 5000  # from which random motions start
# What is called after each assembly, and its arguments beside the state.
CALLS = {
    "assembly": "",
    "gravity": "@_gravity(s + k, phi, out)",
    "forces": "@_forces(s + k, du, ddu, phi, out)",
    "regressor": "@_regressor(s + k, du, ddu, out)",
    "observer": "@_observe(s + k, du, ddu, phi, 10.0, 0.001, out)",
}
LOOP = """
void @_{name}_loop(struct @_state *s, const double *u, const double *du, const double *ddu,
                 const double *phi, double *out, int count, int repeats) {{
  int i, k;
  for (i = 0; i < repeats; ++i)
    for (k = 0; k < count; ++k) {{
      @_assemble(s + k, u + ((i & 1) * count + k) * %DOF);
      {call};
    }}
}}
"""


def main() -> None:
    """Print the figures and write them on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    parser.add_argument(
        "--motions", type=int, default=0, help="random motions each, such as 100000"
    )
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # of free joints and inertias, which are not the point here
    with one_blas_thread():
        rows = [figures(robot, model) for robot in arguments.robots for model in MODELS]
        show("a sample in C and in Python", rows)
        found = {"samples": rows}
        if arguments.motions:
            found["motions"] = [
                row for robot in arguments.robots for row in motions(robot, arguments.motions)
            ]
            show("random motions", found["motions"])
    if arguments.json:
        write_json(arguments.json, found)


def figures(robot: str, model: str) -> dict[str, Any]:
    """A row of the first table."""
    found = force_model(robot, model)
    start = perf_counter()
    code = c_source(found)
    generation = perf_counter() - start
    loops = "".join(LOOP.format(name=name, call=call) for name, call in CALLS.items())
    loops = loops.replace("@", code.name).replace("%", f"{code.name.upper()}_")
    with TemporaryDirectory() as folder:
        start = perf_counter()
        compiled = CompiledRobot(found, replace(code, source=code.source + loops), Path(folder))
        compilation = perf_counter() - start
        q, u, motion = poses_and_motion(found)
        times = {name: in_c(compiled, name, q, u, motion) for name in CALLS}
        forces, expected = compared(compiled, q, u, motion)
    return {
        "robot": robot,
        "model": model,
        "dof": u.shape[2],
        "parameters": len(found.parameters),
        **{f"µs {name}": time for name, time in times.items()},
        "µs in Python": one_by_one(found, q, u, motion),
        "largest difference": float(np.abs(forces - expected).max() / np.abs(expected).max()),
        "kB of C": len(code.source.encode()) / 1000,
        "s to generate": generation,
        "s to compile": compilation,
    }


def motions(robot: str, count: int) -> list[dict[str, Any]]:
    """Rows of the second table."""
    found, rows = force_model(robot, "gravity"), list[dict[str, Any]]()
    mechanism = found.robot
    if not mechanism.rows:
        return rows
    places = random_configurations(mechanism, PLACES, seed=2)
    generator, code = np.random.default_rng(3), c_source(found)
    for steps in (1, 2, 3):
        flags = "-O2", f"-D{code.name.upper()}_NEWTON_STEPS={steps}"
        with TemporaryDirectory() as folder:
            compiled = CompiledRobot(found, code, Path(folder), flags)
        for way in WAYS:
            refused = elsewhere = 0
            for start in range(0, count, PLACES):
                q = places[: min(PLACES, count - start)]
                u = motor_positions(mechanism, q)
                target = u + way * generator.uniform(-1, 1, u.shape)
                reached, status = compiled.moved(q, u, target)
                good = status < 2
                whole = try_assemble(mechanism, target[good], start=q[good])
                same = np.abs(whole.configurations - reached[good]).max(axis=1) < 1e-6
                refused, elsewhere = refused + int((~good).sum()), elsewhere + int((~same).sum())
            rows.append({
                "robot": robot,
                "Newton steps": steps,
                "way, m or rad": way,
                "motions": count,
                "refused": refused,
                "elsewhere": elsewhere,
            })  # fmt: skip
    return rows


def force_model(robot: str, model: str) -> ForceModel:
    """Base parameters of a bundled robot, or of the UR10 of example-robot-data."""
    path = robots_folder() / "ur_description/urdf/ur10_robot.urdf" if robot == "UR10" else robot
    mechanism = loopid.load(path)
    terms = JointTerms(mechanism.actuated, ("Ia", "Fc", "Fv"))
    return loopid.force_model(mechanism, model, terms, search="qr")


def poses_and_motion(model: ForceModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Closed poses (N, nq), motors there and a way off (2, N, dof), their motion (2, dof)."""
    q, generator = random_configurations(model.robot, POSES, seed=1), np.random.default_rng(0)
    u = motor_positions(model.robot, q)
    return (
        q,
        np.stack([u, u + WAY * generator.uniform(-1, 1, u.shape)]),
        generator.normal(size=(2, u.shape[1])),
    )


def in_c(
    compiled: CompiledRobot, name: str, q: np.ndarray, u: np.ndarray, motion: np.ndarray
) -> float:
    """Microseconds of an assembly and a call after it."""
    states = (type(compiled.state) * len(q))()
    for k in range(len(q)):
        compiled.place(q[k], u[0, k])
        states[k] = compiled.state
    out = np.empty(u.shape[2] * len(compiled.model.parameters))
    numbers = [
        np.ascontiguousarray(each).ctypes.data_as(NUMBERS)
        for each in (u, *motion, compiled.model.prior, out)
    ]
    call = compiled.library[f"{compiled.name}_{name}_loop"]
    call.restype = None
    seconds = []
    for _ in range(RUNS):
        start = process_time()
        call(states, *numbers, ctypes.c_int(len(q)), ctypes.c_int(REPEATS))
        seconds.append(process_time() - start)
    return 1e6 * min(seconds) / (len(q) * REPEATS)


def compared(
    compiled: CompiledRobot, q: np.ndarray, u: np.ndarray, motion: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forces (N, dof) a way off, in C and in Python."""
    model, forces = compiled.model, np.zeros(u.shape[1:])
    for k in range(len(q)):
        compiled.place(q[k], u[0, k])
        compiled.call("assemble", u[1, k])
        compiled.call("forces", *motion, model.prior, forces[k])
    there = try_assemble(model.robot, u[1], start=q).configurations
    rates, second = (np.tile(each, (len(q), 1)) for each in motion)
    K = model.base.regressor(model.standard_regressor(there, rates, second))
    return forces, K @ model.prior


def one_by_one(model: ForceModel, q: np.ndarray, u: np.ndarray, motion: np.ndarray) -> float:
    """Microseconds of Python called for each of some samples, as a controller would."""
    rates, second = (each[None] for each in motion)

    def work() -> None:
        for k in range(ONE_BY_ONE):
            there = assemble(model.robot, u[1, k : k + 1], start=q[k])
            model.base.regressor(model.standard_regressor(there, rates, second)) @ model.prior

    return 1e6 * least(work) / ONE_BY_ONE


def least(work: Callable[[], None], runs: int = 5) -> float:
    """Least processor time of some runs in s."""
    seconds = []
    for _ in range(runs):
        start = process_time()
        work()
        seconds.append(process_time() - start)
    return min(seconds)


if __name__ == "__main__":
    main()
