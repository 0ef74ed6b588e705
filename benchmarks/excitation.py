"""How good designed motions are, and how soon: python benchmarks/excitation.py [CASE...].

Wall and processor seconds stand beside each other. 3UPS+RPU runs of the laboratory are made from
the bundled motions.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import numpy as np

import loopid
from example_robots import robots_folder
from loopid.errors import LoopidError
from loopid.excitation import ExcitationDesign

FEASIBLE = ("five_bar", "3rrr", "delta", "6ups", "parallelogram")
KNEE = loopid.MotionLimits(singularity=0.05)


def designed(name: str, robot: Any, **options: Any) -> ExcitationDesign:
    """A design, with its figures on a line."""
    wall, spent = perf_counter(), process_time()
    found = loopid.design_excitation(robot, **options)
    seconds = f"{perf_counter() - wall:6.1f} s wall {process_time() - spent:6.1f} s processor"
    print(
        f"{name:34s} cond {found.criteria.condition_number:10.2f}  log det "
        f"{found.criteria.log_det:8.1f}  measure {found.min_singularity_measure:.3f}  "
        f"{found.violations} violations  {seconds}  {found.solver}, {found.evaluations}",
        flush=True,
    )
    return found


def ur10() -> None:
    """36 base parameters, limits at 90 %, 12 s from rest to rest, 20 s on one core."""
    robot = loopid.load_mechanism(robots_folder() / "ur_description/urdf/ur10_robot.urdf")
    model = loopid.find_force_model(robot, "full")
    for collisions in (False, True):
        limits = loopid.MotionLimits(share=0.9, collisions=collisions)
        options = {"limits": limits, "duration": 12.0, "size": 7, "starts": 2, "time_limit": 20.0}
        for criterion in ("condition", "D"):
            name = f"UR10, {criterion}{', collisions' if collisions else ''}"
            designed(name, model, criterion=criterion, **options)


def knee() -> None:
    """3UPS+RPU: gravity in 20 s, full in 8 s with rates up to 0.3 m/s."""
    robot = loopid.load_mechanism("3ups_rpu")
    options: dict[str, Any] = {"criterion": "condition", "starts": 2, "time_limit": 60.0}
    designed("3UPS+RPU, gravity, 20 s", robot, limits=KNEE, duration=20.0, **options)
    slow = loopid.MotionLimits(singularity=0.05, speeds={"all": 0.3})
    designed("3UPS+RPU, full, 8 s", robot, model="full", limits=slow, duration=8.0, **options)


def feasible() -> None:
    """A design for each robot in 60 s."""
    for name in FEASIBLE:
        designed(name, loopid.load_mechanism(name), model="full", time_limit=60.0)


def seeds() -> None:
    """100 seeds of the 3UPS+RPU: violations after the check, and how far motions were shrunk."""
    robot = loopid.load_mechanism("3ups_rpu")
    model, kept = loopid.find_force_model(robot), 0
    for seed in range(100):
        found = designed(
            f"seed {seed}", model, limits=KNEE, seed=seed, starts=1, iterations=25, time_limit=60.0
        )
        kept += found.violations == 0
    print(f"{kept} of 100 without violations")


def monte_carlo(runs: int = 300) -> None:
    """Standard errors over simulated runs, and of the nine motions cut to the same length."""
    robot = loopid.load_mechanism("3ups_rpu")
    model = loopid.find_force_model(robot)
    found = designed(
        "3UPS+RPU, D", model, limits=KNEE, noise=1.0, duration=20.0, starts=2, time_limit=60.0
    )
    exact = loopid.simulate_measurement(robot, found.joint_motion).force
    W = model.regressor(found.joint_motion).reshape(-1, len(model.parameters))
    values = [
        np.linalg.lstsq(W, (exact + error).ravel(), rcond=None)[0]
        for error in np.random.default_rng(0).normal(size=(runs, *exact.shape))
    ]
    ratios = np.std(values, axis=0, ddof=1) / found.standard_errors
    spread = f"{ratios.min():.3f} ... {ratios.max():.3f}, rms {np.sqrt((ratios**2).mean()):.3f}"
    print(f"standard errors over {runs} runs / predicted: {spread}")
    program, factors = loopid.read_motion_program("3ups_rpu"), []
    for name in program.motions:
        planned = program.motion(name)
        rows = slice(0, None, max(1, round(len(program.motions) * len(planned) / len(W) * 4)))
        cut = loopid.joint_motion(robot, planned).select(rows)
        factors.append(model.regressor(cut).reshape(-1, W.shape[1]))
    nine = np.concatenate(factors)
    nine = nine * np.sqrt(len(W) / len(nine))  # as many samples as the design has
    old = np.sqrt(np.diag(np.linalg.inv(nine.T @ nine)))
    better = np.exp(np.log(old / found.standard_errors).mean())
    print(f"nine laboratory motions, as many samples: errors {better:.2f} times as large")


def refusals() -> None:
    """Impossible requests."""
    robot = loopid.load_mechanism("3ups_rpu")
    for limits in (
        {"singularity": 0.6},
        {"workspace": {"x_m": (2.0, 3.0)}},
        {"positions": {"leg1_stroke": (0.1, 0.2)}},
        {"forces": {"all": 0.1}},
    ):
        start = perf_counter()
        try:
            loopid.design_excitation(robot, limits=loopid.MotionLimits(**limits))
        except LoopidError as error:
            print(f"{perf_counter() - start:5.1f} s  {error}", flush=True)


CASES: dict[str, Callable[[], None]] = {
    case.__name__: case for case in (ur10, knee, feasible, seeds, monte_carlo, refusals)
}

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for wanted in sys.argv[1:] or CASES:
        print(f"-- {wanted}: {CASES[wanted].__doc__}", flush=True)
        CASES[wanted]()
