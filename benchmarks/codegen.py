"""Microseconds per call of generated C regressors, beside Python's, and whether they agree.

    python benchmarks/codegen.py [--json FILE] [ROBOT ...]

K_base(q, q̇, q̈) with drive inertia and friction of all motors, at random closed poses: the C
function, compiled with -O2, in a loop of C; Python on one sample after the other; and Python on
all samples at once, per sample. Medians of some runs in one process, in processor
time.
"""

from __future__ import annotations

import argparse
import ctypes
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

import numpy as np

from compiled_c import NUMBERS, CompiledRegressor
from example_robots import robots_folder
from loopid import JointTerms, find_force_model, load_mechanism, random_configurations
from loopid.export import regressor_code
from loopid.identification import ForceModel
from loopid.kinematics import ClosedMotion, closed_motion
from loopid.regressors import motion_regressor
from loopid.workers import one_blas_thread
from tables import show, write_json

ROBOTS = ("five_bar", "3ups_rpu", "delta", "6ups", "UR10")
MODELS = ("gravity", "full")
SAMPLES, ONE_BY_ONE, REPEATS, RUNS = 500, 30, 20, 5
LOOP = """
void @_loop(const double *q, const double *v, const double *a, double *K, int count, int repeats) {
  int i, k;
  for (i = 0; i < repeats; ++i)
    for (k = 0; k < count; ++k)
      @_regressor(q + k * %NQ, v + k * %NV, a + k * %NV, K + k * %DOF * %PARAMETERS);
}
"""


def main() -> None:
    """Print the figures and write them on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # of free joints and inertias, which are not the point here
    with one_blas_thread():
        rows = [figures(robot, model) for robot in arguments.robots for model in MODELS]
    show("regressors in C and in Python", rows)
    if arguments.json:
        write_json(arguments.json, {"regressors": rows})


def figures(robot: str, model: str) -> dict[str, Any]:
    """A row of the table."""
    found = force_model(robot, model)
    start = perf_counter()
    code = regressor_code(found)
    generation = perf_counter() - start
    source = code.source + LOOP.replace("@", code.name).replace("%", f"{code.name.upper()}_")
    with TemporaryDirectory() as folder:
        start = perf_counter()
        compiled = CompiledRegressor(found, replace(code, source=source), Path(folder))
        compilation = perf_counter() - start
        motion = moved(found)
        in_c = per_sample(c_loop(compiled, motion), SAMPLES * REPEATS)
        K, _ = compiled(motion.configurations, motion.velocities, motion.accelerations)
    expected = python_regressor(found, motion)
    one = per_sample(lambda: one_by_one(found, motion), ONE_BY_ONE)
    together = per_sample(lambda: python_regressor(found, motion), SAMPLES)
    return {
        "robot": robot,
        "model": model,
        "dof": K.shape[1],
        "parameters": K.shape[2],
        "µs in C": in_c,
        "Python, one sample": one,
        "Python, all at once": together,
        "one sample over C": one / in_c,
        "largest difference": float(np.abs(K - expected).max() / np.abs(expected).max()),
        "kB of C": len(code.source.encode()) / 1000,
        "s to generate": generation,
        "s to compile": compilation,
    }


def force_model(robot: str, model: str) -> ForceModel:
    """Base parameters of a bundled robot, or of the UR10 of example-robot-data."""
    path = robots_folder() / "ur_description/urdf/ur10_robot.urdf" if robot == "UR10" else robot
    mechanism = load_mechanism(path)
    terms = JointTerms(mechanism.actuated, ("Ia", "Fc", "Fv"))
    return find_force_model(mechanism, model, terms, search="qr")


def moved(model: ForceModel) -> ClosedMotion:
    """Random motion through closed poses."""
    q = random_configurations(model.mechanism, SAMPLES, seed=0)
    shape = 2, SAMPLES, len(model.mechanism.independent)
    return closed_motion(model.mechanism, q, *np.random.default_rng(0).standard_normal(shape))


def python_regressor(model: ForceModel, motion: ClosedMotion) -> np.ndarray:
    """The same with everything that C computes: the projection, then the base columns."""
    chosen = model.mechanism.velocity_indices(model.mechanism.independent)
    rates, second = motion.velocities[:, chosen], motion.accelerations[:, chosen]
    whole = closed_motion(model.mechanism, motion.configurations, rates, second)
    W = motion_regressor(model.mechanism, whole, model.model, joint_terms=model.joint_terms)
    return model.base.regressor(W)


def one_by_one(model: ForceModel, motion: ClosedMotion) -> None:
    """Python called for each of some samples, as a controller would."""
    chosen = model.mechanism.velocity_indices(model.mechanism.independent)
    for k in range(ONE_BY_ONE):
        q = motion.configurations[k : k + 1]
        rates, second = motion.velocities[k, chosen], motion.accelerations[k, chosen]
        whole = closed_motion(model.mechanism, q, rates, second)
        model.base.regressor(
            motion_regressor(model.mechanism, whole, model.model, joint_terms=model.joint_terms)
        )


def c_loop(compiled: CompiledRegressor, motion: ClosedMotion) -> Callable[[], None]:
    """All samples, several times over, without Python in between."""
    states = motion.configurations, motion.velocities, motion.accelerations
    model = compiled.model
    K = np.empty((SAMPLES, len(model.mechanism.independent), len(model.parameters)))
    arrays = [np.ascontiguousarray(part) for part in (*states, K)]
    call = compiled.function("loop", None, 4)
    call.argtypes = [*call.argtypes, ctypes.c_int, ctypes.c_int]
    pointers = [array.ctypes.data_as(NUMBERS) for array in arrays]
    return lambda: call(*pointers, SAMPLES, REPEATS)


def per_sample(work: Callable[[], object], samples: int) -> float:
    """Median microseconds of processor time per sample."""
    work()
    seconds = []
    for _ in range(RUNS):
        start = process_time()
        work()
        seconds.append(process_time() - start)
    return 1e6 * median(seconds) / samples


if __name__ == "__main__":
    main()
