"""Physically consistent fits: time, verdicts, and predictions beside the unconstrained fit.

    python benchmarks/consistency.py [--draws N] [--json FILE]

The 3UPS+RPU with friction, full model: 90 parameters of bodies. Times are medians of processor
time of whole calls, the check for feasibility included, in one run with the unconstrained fit.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from loopid import JointTerms, find_force_model, joint_motion, load_mechanism
from loopid.arguments import FloatArray
from loopid.base_parameters import BaseParameters
from loopid.identification import (
    REGULARISATIONS,
    ConsistentFit,
    FitProblem,
    FitResult,
    FitSamples,
    WeightedLeastSquares,
    consistent_fit,
)
from loopid.inertia import pseudo_inertia
from loopid.kinematics import platform_coordinates
from loopid.motion import FourierSeries
from tables import show, write_json

RUNS = 9
NOISE = 5.0  # N
FRICTION = (17.0, 320.0, 22.0, 320.0, 19.0, 320.0, 230.0, 2000.0)  # Fc, Fv of each leg


@dataclass(frozen=True)
class Case:
    """Base parameters, the regressor of a motion, and the truth."""

    base: BaseParameters
    regressor: FloatArray
    truth: FloatArray
    actuators: tuple[str, ...]

    @property
    def prior(self) -> FloatArray:
        """The truth of the bodies; of friction nothing is known."""
        return np.concatenate([self.truth[:90], np.zeros(len(self.truth) - 90)])

    def fitted(self, seed: int) -> tuple[FitProblem, FitResult]:
        """Noisy data and their unconstrained fit."""
        force = self.regressor @ self.base.values(self.truth)
        force = force + NOISE * np.random.default_rng(seed).normal(size=force.shape)
        leading = self.base.parameters.select(self.base.base)
        problem = FitSamples.of(leading, self.actuators, self.regressor, force).problem
        return problem, WeightedLeastSquares().fit(problem)


def main() -> None:
    """Print the tables and write them on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--draws", type=int, default=200, help="noisy cases")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    case = lively_case()
    times, counts = timings(case), noisy_cases(case, arguments.draws)
    show(f"one fit of 90 parameters, medians of {RUNS} runs", times)
    show(f"{arguments.draws} fits of noisy data, {NOISE:g} N", counts)
    if arguments.json:
        write_json(arguments.json, {"times": times, "noisy": counts})


def lively_case() -> Case:
    """Ten seconds of a motion in all directions at 60 Hz."""
    robot = load_mechanism("3ups_rpu")
    model = find_force_model(robot, "full", JointTerms(robot.actuated))
    assert robot.platform is not None
    names = robot.platform.names
    middle = platform_coordinates(robot, robot.reference[None])[0]
    waves = np.random.default_rng(1).normal(size=(2, len(names), 5))
    sizes = np.array([0.06, 0.04, 0.2, 0.2])
    reach = np.abs(FourierSeries(names, 0.1, middle, *waves).motion(10.0, 60.0).position - middle)
    sine, cosine = waves * (sizes / reach.max(axis=0))[:, None]
    series = FourierSeries(names, 0.1, middle, sine, cosine)
    W = model.regressor(joint_motion(robot, series.motion(10.0, 60.0)))
    truth = np.concatenate([robot.standard_parameters("full"), FRICTION])
    return Case(model.base, W, truth, robot.actuated)


def timings(case: Case) -> list[dict[str, Any]]:
    """Milliseconds of each regularisation, and of the unconstrained fit."""
    problem, fit = case.fitted(0)
    rows = [{"fit": "unconstrained", "ms": timed(lambda: WeightedLeastSquares().fit(problem))}]
    for kind in REGULARISATIONS:

        def once(kind: str = kind) -> ConsistentFit:
            return consistent_fit(problem, fit, case.base, case.prior, regularisation=kind)

        rows.append({"fit": kind, "ms": timed(once)})
    return rows


def timed(work: Any) -> float:
    """Median of several runs, in ms."""
    times = []
    for _ in range(RUNS):
        start = process_time()
        work()
        times.append(process_time() - start)
    return 1e3 * median(times)


def noisy_cases(case: Case, draws: int) -> list[dict[str, Any]]:
    """How many results are consistent, and how far predictions move: the worst and the mean."""
    consistent, moved, ratios, times = 0, [], [], []
    for seed in range(draws):
        problem, fit = case.fitted(seed)
        start = process_time()
        result = consistent_fit(problem, fit, case.base, case.prior)
        times.append(process_time() - start)
        bodies = pseudo_inertia(result.standard_parameters[:90].reshape(9, 10))
        friction = result.standard_parameters[90:]
        consistent += bool((np.linalg.eigvalsh(bodies) > 0).all() and (friction >= 0).all())
        free = case.regressor @ fit.values
        moved.append(np.linalg.norm(case.regressor @ result.values - free) / np.linalg.norm(free))
        ratios.append(result.fit_cost.total)
    row = {
        "consistent": f"{consistent} of {draws}",
        "longest ms": 1e3 * max(times),
        "predictions moved, worst %": 100 * max(moved),
        "residual rms, worst ratio": max(ratios),
        "mean ratio": float(np.mean(ratios)),
    }
    return [row]


if __name__ == "__main__":
    main()
