"""Which estimator for which errors: a Monte Carlo with known truth.

    python benchmarks/estimators.py [--runs N] [--robot NAME] [--only CASE] [--recommended]

Each row is an estimator on this many seeded repetitions of errors: how often 95 % intervals cover
the true value, on average over the parameters and for the worst and best of them; the size of its
errors, the root mean square over the parameters of their standard deviation about the truth, each
relative to the bound for independent errors without outliers; and the largest mean error, in
standard deviations of the estimates.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

import loopid
from example_robots import robots_folder
from loopid import JointTerms
from loopid.errors import LoopidError
from loopid.identification import Estimator, Fit, FitSamples, ForceModel
from loopid.identification.fitting import quiet_fit
from loopid.motion import FourierSeries, LowPass, Motion, joint_motion, read_motion_program
from loopid.motion.filtering import differentiate
from loopid.workers import one_blas_thread
from tables import show, write_json

UR10 = "ur_description/urdf/ur10_robot.urdf"
# Coulomb, viscous friction and offset of the UR10's joints; Coulomb and viscous of the 3UPS+RPU's.
UR10_FRICTION = np.tile([8.0, 10.0, 1.0], 3), np.tile([2.0, 1.5, 0.3], 3)
KNEE_FRICTION = 17.0, 320.0, 22.0, 320.0, 19.0, 320.0, 230.0, 2000.0
CORRELATION, LEAD = 0.9, 200  # of neighbouring errors; samples before the first
OUTLIERS, OUTLIER_SIZE = 0.05, 12.0  # share of all samples; N or N m
# Positions that are measured: noise in rad, rate, and cut-off of the filter in Hz.
POSITION_NOISE, RATE, CUTOFF, CUT = 5e-4, 100.0, 10.0, 50
# Rate in rad/s below which a joint counts as standing: noise would turn the sign of its friction.
STANDING = 0.05
HARMONICS, FREQUENCY = 5, 0.1
# What docs/estimators.md recommends for each kind of errors.
RECOMMENDED = {
    "white, one size": "ols",
    "white": "wls",
    "AR(1)": "wls",
    "outliers": "bisquare",
    "AR(1), outliers": "bisquare",
    "noisy positions": "iv",
}
# Cases whose errors are of one size for all motors.
ONE_SIZE = ("white, one size",)
Errors = Callable[[np.random.Generator], np.ndarray]
# Samples, true values and estimator options of a repetition.
Run = tuple[FitSamples, np.ndarray, dict[str, Estimator]]
Draw = Callable[[np.random.Generator], Run]


@dataclass(frozen=True)
class Case:
    """Samples without errors, true values (n,), sizes of the errors (dof,); a few first samples."""

    name: str
    model: ForceModel
    motion: Motion | None
    samples: FitSamples
    truth: np.ndarray
    deviations: np.ndarray
    few: int

    def errors(
        self, correlation: float = 0.0, outliers: float = 0.0, equal: bool = False
    ) -> Errors:
        """Normal autocorrelated errors, and outliers of either sign beside them."""
        shape = self.samples.force.shape
        sizes = np.full(shape[1], self.deviations.mean()) if equal else self.deviations

        def draw(rng: np.random.Generator) -> np.ndarray:
            white = rng.normal(size=(LEAD + shape[0], shape[1])) * np.sqrt(1 - correlation**2)
            normal = lfilter([1.0], [1.0, -correlation], white, axis=0)[LEAD:] * sizes
            sign = rng.choice([-OUTLIER_SIZE, OUTLIER_SIZE], size=shape)
            return np.asarray(normal + np.where(rng.random(shape) < outliers, sign, 0.0))

        return draw


def knee() -> Case:
    """The 3UPS+RPU on its nine trajectories, a sample a second: gravity and friction."""
    robot, program = loopid.load("3ups_rpu"), read_motion_program("3ups_rpu")
    model = loopid.force_model(robot, "gravity", JointTerms(robot.actuated))
    motions = [joint_motion(robot, program.motion(name, 1.0)) for name in program.motions]
    W = np.concatenate([model.regressor(motion) for motion in motions])
    segments = np.repeat(np.arange(len(motions)), [len(motion.time) for motion in motions])
    deviations = np.array([2.0, 2.0, 2.0, 4.0])
    few = len(motions[0].time)
    return _case("3UPS+RPU", model, None, W, np.array(KNEE_FRICTION), deviations, few, segments)


def ur10() -> Case:
    """The UR10 on a Fourier series of 10 s, 100 samples a second: all terms and friction."""
    robot = loopid.load(str(Path(robots_folder()) / UR10))
    model = loopid.force_model(robot, "full", JointTerms(robot.actuated, ("Fc", "Fv", "Fo")))
    size = 0.5 / np.arange(1, HARMONICS + 1)
    sine, cosine = np.random.default_rng(0).normal(size=(2, 6, HARMONICS)) * size
    middle = np.array([0.0, -1.2, 1.2, 0.0, 0.5, 0.0])
    motion = FourierSeries(robot.actuated, FREQUENCY, middle, sine, cosine).motion(rate=RATE)
    W = model.regressor(joint_motion(robot, motion))
    deviations = np.array([2.0, 3.0, 2.0, 0.5, 0.5, 0.5])
    return _case("UR10", model, motion, W, np.concatenate(UR10_FRICTION), deviations, len(W) // 2)


def _case(
    name: str,
    model: ForceModel,
    motion: Motion | None,
    W: np.ndarray,
    friction: np.ndarray,
    deviations: np.ndarray,
    few: int,
    segments: np.ndarray | None = None,
) -> Case:
    bodies = model.robot.standard_parameters(model.model)
    truth = model.base.values(np.concatenate([bodies, friction]))
    actuators = model.robot.independent
    samples = FitSamples.of(model.parameters, actuators, W, W @ truth, segments=segments)
    return Case(name, model, motion, samples, truth, deviations, few)


def measured_motion(case: Case, rng: np.random.Generator) -> FitSamples:
    """Samples whose positions were measured with noise, filtered and differentiated twice.

    The true motion, whose regressor made the forces, is the instrument.
    """
    assert case.motion is not None
    lowpass, noise = LowPass(CUTOFF), rng.normal(size=case.motion.position.shape)
    position = lowpass.apply(case.motion.position + POSITION_NOISE * noise, RATE)
    velocity = differentiate(position, RATE)
    acceleration = differentiate(velocity, RATE)
    names, time = case.motion.names, case.motion.time
    robot = case.model.robot
    moved = joint_motion(robot, Motion(names, time, position, velocity, acceleration))
    force = case.samples.force + case.errors()(rng)
    inside = slice(CUT, len(time) - CUT)
    W, used = case.model.regressor(moved)[inside], np.abs(case.motion.velocity) > STANDING
    parameters, actuators = case.samples.parameters, case.samples.actuators
    samples = FitSamples.of(parameters, actuators, W, force[inside], used=used[inside])
    return samples.with_instruments(case.samples.regressor[inside])


def main() -> None:
    """Print a table a robot, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=100, help="repetitions of each case")
    parser.add_argument("--robot", choices=["3ups_rpu", "ur10"], help="one robot only")
    parser.add_argument("--only", default="", help="cases whose name starts so")
    parser.add_argument("--recommended", action="store_true", help="only what the page recommends")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    figures = {}
    for name, make in (("3ups_rpu", knee), ("ur10", ur10)):
        if arguments.robot in (None, name):
            case = make()
            rows = list(table(case, arguments.runs, arguments.only, arguments.recommended))
            size = f"{len(case.truth)} parameters, {len(case.samples)} samples"
            show(f"{case.name}: {size}, {arguments.runs} runs", rows)
            figures[case.name] = rows
    if arguments.json:
        write_json(arguments.json, figures)


def table(case: Case, runs: int, only: str, recommended: bool) -> Iterator[dict[str, Any]]:
    """Rows of all kinds of errors."""
    for name, draw, estimators in scenarios(case):
        if name.startswith(only):
            chosen = (RECOMMENDED[name],) if recommended else estimators
            yield from judged(case, name, draw, chosen, runs)


def scenarios(case: Case) -> Iterator[tuple[str, Draw, tuple[str, ...]]]:
    """Name, repetition and estimators of each kind of errors."""
    robust = ("wls", "bisquare")
    yield "white, one size", forces(case, equal=True), ("ols",)
    yield "white", forces(case), ("ols", *robust)
    yield "AR(1)", forces(case, correlation=CORRELATION), ("wls", "bisquare")
    yield "outliers", forces(case, outliers=OUTLIERS), robust
    yield "AR(1), outliers", forces(case, CORRELATION, OUTLIERS), ("wls", "bisquare")
    if case.motion is not None:
        yield (
            "noisy positions",
            lambda rng: (measured_motion(case, rng), case.truth, {}),
            ("wls", "iv"),
        )


def forces(
    case: Case, correlation: float = 0.0, outliers: float = 0.0, equal: bool = False
) -> Draw:
    """Forces with errors."""
    errors = case.errors(correlation, outliers, equal)
    return lambda rng: (case.samples.with_force(case.samples.force + errors(rng)), case.truth, {})


def judged(
    case: Case, name: str, draw: Draw, estimators: tuple[str, ...], runs: int
) -> list[dict[str, Any]]:
    """A row an estimator; the same errors for all of them."""
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {key: [] for key in estimators}
    with one_blas_thread():
        for seed in range(runs):
            samples, truth, options = draw(np.random.default_rng(seed))
            for key in estimators:
                # Refused, where data do not allow an answer.
                with suppress(LoopidError):
                    fit = quiet_fit(samples, options.get(key, key))
                    found[key].append((fit.values - truth, covers(fit, truth)))
    bound = bounds(case, samples, equal=name in ONE_SIZE)
    return [row(name, key, found[key], bound, runs) for key in estimators]


def covers(fit: Fit, truth: np.ndarray) -> np.ndarray:
    """Which intervals (n,) cover the true values."""
    low, high = fit.intervals().T
    return np.asarray((low <= truth) & (truth <= high))


def bounds(case: Case, samples: FitSamples, equal: bool) -> np.ndarray:
    """Least covariance (n, n) of unbiased estimates for independent errors (Cramér and Rao)."""
    sizes = np.full(len(case.deviations), case.deviations.mean()) if equal else case.deviations
    width = len(case.truth)
    R = samples.problem.weighted(1.0 / sizes)[:width, :width]
    inverse = np.linalg.inv(R)
    return np.asarray(inverse @ inverse.T)


def row(
    name: str,
    estimator: str,
    found: list[tuple[np.ndarray, np.ndarray]],
    bound: np.ndarray,
    runs: int,
) -> dict[str, Any]:
    """Figures of an estimator."""
    errors, covered = (np.array(column) for column in zip(*found, strict=True))
    rates, variances = 100 * covered.mean(axis=0), (errors**2).mean(axis=0) / np.diag(bound)
    bias = np.abs(errors.mean(axis=0)) / errors.std(axis=0)
    return {
        "errors": name,
        "estimator": estimator,
        "covered %": float(rates.mean()),
        "least %": float(rates.min()),
        "most %": float(rates.max()),
        "variance / bound": float(variances.mean()),
        "bias / std": float(bias.max()),
        "refused": runs - len(found),
    }


if __name__ == "__main__":
    main()
