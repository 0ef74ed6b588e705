"""The recommended fit beside the robot file and least squares: a Monte Carlo with known truth.

    python benchmarks/consistency.py [--logs N] [--robot NAME] [--kind KIND] [--json FILE]

Each row is a robot and a kind of error of its file, with bodies, friction and noise drawn anew for
each simulated log of 20 s at 100 Hz, with encoders of 17 bits: bodies off by this many per cent in
size, in shape, or one body three times as heavy as in the file, or as light. On another motion, the
squared error of the forces relative to that of the robot file with fitted joint terms, median and
worst, of all parameters by least squares, of the consistent fit, and of what is recommended; how
often 95 % intervals of the consistent fit cover the truth, on average and for the worst parameter;
how often the recommended one is worse than the robot file, and can be exported; the heaviest body
over the true one or the robot file's, whichever is heavier; and the time of the fit.
"""

from __future__ import annotations

import argparse
import warnings
from collections import defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np

import loopid
from example_robots import robots_folder
from loopid import JointTerms, identify
from loopid.arguments import FloatArray
from loopid.export.robot_file import export_robot_file
from loopid.identification import Identification, consistent_fit
from loopid.inertia import parameters_of, pseudo_inertia
from loopid.logs import Log
from loopid.motion import FourierSeries, JointMotion, joint_motion, scaled_bodies
from loopid.workers import one_blas_thread
from tables import show, write_json

RATE, SECONDS, BITS = 100.0, 20.0, 17
HARMONICS, FREQUENCY = 5, 0.1
# File; middle (rad, m) and size of the motion; Coulomb and viscous friction; noise of the forces.
ROBOTS: dict[str, tuple[str, Any, Any, Any, Any]] = {
    "five_bar": ("five_bar", None, 0.25, (0.1, 0.05), 0.05),
    "delta": ("delta", None, 0.2, (0.1, 0.05), 0.05),
    "ur10": (
        "ur_description/urdf/ur10_robot.urdf",
        (0.0, -1.2, 1.2, 0.0, 0.5, 0.0),
        0.5,
        np.concatenate([np.tile([8.0, 10.0], 3), np.tile([2.0, 1.5], 3)]),
        np.array([2.0, 3.0, 2.0, 0.5, 0.5, 0.5]),
    ),
    "6ups": ("6ups", None, 0.02, (5.0, 50.0), 1.0),
}
KINDS = ("20 %", "35 %", "shapes 30 %", "one body")
FRICTION_SPREAD, HEAVY = 0.3, 3.0
SLACK = 1e-9


class Case:
    """A robot on two motions, one to fit and one to judge, and what their forces are made of."""

    def __init__(self, name: str) -> None:
        file, self.middle, self.size, friction, noise = ROBOTS[name]
        path = Path(robots_folder()) / file
        self.robot = loopid.load(str(path) if path.suffix == ".urdf" else file)
        motors = self.robot.actuated
        count = 2 * len(motors)
        self.friction = np.resize(np.asarray(friction, dtype=float), count)
        self.noise = np.broadcast_to(noise, len(motors))
        self.model = loopid.force_model(self.robot, "full", JointTerms(motors, ("Fc", "Fv")))
        self.motions = [self.moved(seed) for seed in (0, 1)]
        states = [(m.configurations, m.velocities, m.accelerations) for m in self.motions]
        self.K, self.K_new = (self.model.standard_regressor(*state) for state in states)

    def moved(self, seed: int) -> JointMotion:
        """A Fourier series of the motors."""
        robot, names = self.robot, self.robot.actuated
        if self.middle is None:
            middle = np.array([robot.reference[robot.joint(each).idx_q] for each in names])
        else:
            middle = np.array(self.middle)
        waves = np.random.default_rng(seed).normal(size=(2, len(names), HARMONICS))
        waves = self.size * waves / np.arange(1, HARMONICS + 1)
        series = FourierSeries(names, FREQUENCY, middle, *waves)
        return joint_motion(robot, series.motion(rate=RATE, duration=SECONDS))

    def truth(self, kind: str, seed: int) -> FloatArray:
        """Standard parameters and friction (p,) of one robot of a kind."""
        generator = np.random.default_rng(seed)
        file = self.robot.standard_parameters("full")
        if kind == "one body":
            bodies = file.reshape(-1, 10).copy()
            massive = np.flatnonzero(bodies[:, 0] > 0)
            bodies[generator.choice(massive)] *= HEAVY ** generator.choice([-1, 1])
        elif kind.startswith("shapes"):
            bodies = reshaped(file.reshape(-1, 10), 0.3, generator)
        else:
            bodies = scaled_bodies(self.robot, float(kind.split()[0]) / 100, seed=seed)
        spread = np.exp(FRICTION_SPREAD * generator.normal(size=len(self.friction)))
        return np.concatenate([np.ravel(bodies), self.friction * spread])

    def log(self, truth: FloatArray, seed: int) -> Log:
        """What sensors read: forces with noise, positions in steps from an unknown zero."""
        generator, step = np.random.default_rng([seed, 1]), 2 * np.pi / 2**BITS
        indices = [self.robot.joint(each).idx_q for each in self.robot.actuated]
        exact = self.motions[0].configurations[:, indices]
        sliding = self.robot.velocity_indices(self.robot.actuated)
        step = np.where(np.isin(sliding, self.robot.prismatic), 1e-6, step)
        zero = step * generator.uniform(size=exact.shape[1])
        position = step * np.round((exact - zero) / step) + zero
        force = self.K @ truth + self.noise * generator.normal(size=exact.shape)
        return Log.from_arrays(self.motions[0].time, position, force, self.robot.actuated)


def reshaped(bodies: FloatArray, size: float, generator: np.random.Generator) -> FloatArray:
    """Bodies (n, 10) that are heavier, longer and elsewhere by a part of their sizes."""
    found = bodies.copy()
    for k, own in enumerate(bodies):
        if own[0] > 0:
            L = np.linalg.cholesky(pseudo_inertia(own))
            values, axes = np.linalg.eigh(symmetric(generator, size))
            found[k] = parameters_of(L @ (axes * np.exp(values)) @ axes.T @ L.T)
    return found


def symmetric(generator: np.random.Generator, size: float) -> FloatArray:
    """A random matrix (4, 4), isotropic."""
    A = generator.normal(scale=size, size=(4, 4))
    return np.asarray((A + A.T) / 2)


def figures(case: Case, kind: str, logs: int) -> dict[str, Any]:
    """Figures of this many logs."""
    numbers = defaultdict[str, list[Any]](list)
    for seed in range(logs):
        truth = case.truth(kind, seed)
        run = loopid.prepare(case.robot, case.log(truth, seed))
        found = identify(case.model, [run])
        for name, value in one_log(case, found, truth).items():
            numbers[name].append(value)
    covered = 100 * np.mean(numbers.pop("covered"), axis=0)
    ratios = {name: np.array(numbers.pop(name)) for name in ("least squares", "fit", "recommended")}
    return {
        "least squares": "{:.3g} ({:.3g})".format(*_summary(ratios["least squares"])),
        "fit": "{:.3g} ({:.3g})".format(*_summary(ratios["fit"])),
        "recommended": "{:.3g} ({:.3g})".format(*_summary(ratios["recommended"])),
        "covered %": float(covered.mean()),
        "least %": float(covered.min()),
        "worse": int((ratios["recommended"] > 1 + SLACK).sum()),
        "exported": int(np.sum(numbers["exported"])),
        "heaviest": float(np.max(numbers["heaviest"])),
        "deviation": float(np.median(numbers["deviation"])),
        "s": float(np.median(numbers["seconds"])),
    }


def _summary(ratio: FloatArray) -> tuple[float, float]:
    return float(np.median(ratio)), float(ratio.max())


def one_log(case: Case, found: Identification, truth: FloatArray) -> dict[str, Any]:
    """What one identification found."""
    base, W = case.model.base, case.model.base.regressor(case.K_new)
    exact, fit = base.values(truth), found["consistent"].fit

    def error(values: FloatArray) -> float:
        return float((((W @ (values - exact)) / case.noise) ** 2).mean())

    file = error(found["robot file"].fit.values)
    low, high = fit.intervals().T
    start = process_time()
    noise = found["all parameters"].fit.noise
    assert noise is not None
    consistent_fit(case.model, found.data, noise)
    seconds = process_time() - start
    standard = found.fit.standard_parameters
    assert standard is not None
    own, width = case.robot.standard_parameters("full"), 10
    masses = standard[: len(own) : width]
    largest = np.maximum(own[::width], truth[: len(own) : width])
    massive = largest > 0
    return {
        "least squares": error(found["all parameters"].fit.values) / file,
        "fit": error(fit.values) / file,
        "recommended": error(found.fit.values) / file,
        "covered": (low <= exact) & (exact <= high),
        "exported": exported(case, found),
        "heaviest": float((masses[massive] / largest[massive]).max()),
        "deviation": found.prior_deviation,
        "seconds": seconds,
    }


def exported(case: Case, found: Identification) -> bool:
    """Whether the recommended bodies can be written to the robot's file."""
    standard = found.fit.standard_parameters
    if standard is None:
        return False
    with TemporaryDirectory() as folder:
        place = f"{folder}/new.urdf"
        export_robot_file(case.robot, standard, place, parameters=case.model.base.parameters)
        return Path(place).exists()


def main() -> None:
    """Print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--logs", type=int, default=100, help="logs of each kind")
    parser.add_argument("--robot", choices=list(ROBOTS), help="one robot only")
    parser.add_argument("--kind", choices=KINDS, help="one kind of errors only")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    with one_blas_thread():
        for name in ROBOTS if arguments.robot is None else [arguments.robot]:
            case = Case(name)
            for kind in KINDS if arguments.kind is None else [arguments.kind]:
                head = {"robot": name, "bodies off by": kind}
                rows.append(head | figures(case, kind, arguments.logs))
    show(f"{arguments.logs} logs each: squared error over the robot file's, median (worst)", rows)
    if arguments.json:
        write_json(arguments.json, {"fits": rows})


if __name__ == "__main__":
    main()
