"""Whether 95 % intervals from noisy logs hold with default options: a Monte Carlo with known truth.

    python benchmarks/intervals.py [--runs N] [--robot NAME] [--rate HZ] [--bits N]

Each row is a robot with bodies that are some 20 % off its file and with friction, on one motion, at
a sample rate and with encoders of so many bits a turn: the cut-off that the log asks for, how often
intervals of all parameters by weighted least squares cover the true values, on average over the
parameters and for the worst, and the root mean square and the largest mean of errors in standard
errors: 1 and 0 where all is well. Seeds draw the noise of the forces and the phases of the
encoders.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from example_robots import robots_folder
from loopid import (
    FourierSeries,
    JointTerms,
    find_force_model,
    joint_motion,
    load_mechanism,
    prepare_recording,
    read_motion_program,
    simulate_measurement,
)
from loopid.identification import ForceModel, quiet_fit
from loopid.logs import Log
from loopid.motion import Motion, scaled_bodies
from loopid.motion.simulation import Measurement
from loopid.workers import one_blas_thread
from tables import show, write_json

UR10 = "ur_description/urdf/ur10_robot.urdf"
RATES, BITS = (100.0, 500.0, 1000.0, 5000.0), (17, 20)
CAD_ERROR = 0.2
HARMONICS, FREQUENCY, SECONDS = 5, 0.1, 20.0
# Middle and size (rad) of the Fourier series, Coulomb and viscous friction, noise of the forces.
MOTIONS: dict[str, tuple[tuple[float, ...] | None, float]] = {
    "five_bar": (None, 0.25),
    "delta": (None, 0.2),
    "ur10": ((0.0, -1.2, 1.2, 0.0, 0.5, 0.0), 0.5),
}
SMALL_FRICTION, SMALL_NOISE = (0.1, 0.05), 0.02  # N m, N m s/rad; N m
UR10_FRICTION = np.concatenate([np.tile([8.0, 10.0], 3), np.tile([2.0, 1.5], 3)])
UR10_NOISE = np.array([2.0, 3.0, 2.0, 0.5, 0.5, 0.5])


class Case:
    """A robot on a motion at a rate: its force model, true values (n,), and what sensors read."""

    def __init__(self, name: str, motion: str, rate: float) -> None:
        file = str(Path(robots_folder()) / UR10) if name == "ur10" else name
        self.robot = load_mechanism(file)
        m = len(self.robot.actuated)
        friction = UR10_FRICTION if name == "ur10" else np.tile(SMALL_FRICTION, m)
        self.noise = UR10_NOISE if name == "ur10" else np.full(m, SMALL_NOISE)
        terms = JointTerms(self.robot.actuated, ("Fc", "Fv"))
        self.model: ForceModel = find_force_model(self.robot, "full", terms)
        bodies = scaled_bodies(self.robot, CAD_ERROR)
        self.truth = self.model.base.values(np.concatenate([bodies, friction]))
        moved = joint_motion(self.robot, self.planned(name, motion, rate))
        self.exact: Measurement = simulate_measurement(
            self.robot,
            moved,
            standard_parameters=bodies,
            joint_terms=terms,
            joint_values=friction,
        )

    def planned(self, name: str, motion: str, rate: float) -> Motion:
        """The bundled motion, with stops, or a Fourier series."""
        if motion != "fourier":
            return read_motion_program(name).motion(motion, rate)
        middle, size = MOTIONS[name]
        if middle is None:
            reference, joints = self.robot.reference, self.robot.actuated
            middle = tuple(reference[self.robot.joint(joint).idx_q] for joint in joints)
        sizes = size / np.arange(1, HARMONICS + 1)
        sine, cosine = np.random.default_rng(0).normal(size=(2, len(middle), HARMONICS)) * sizes
        series = FourierSeries(self.robot.actuated, FREQUENCY, np.array(middle), sine, cosine)
        return series.motion(rate=rate, duration=SECONDS)

    def log(self, bits: int, seed: int) -> Log:
        """A log with noise of forces, and positions in steps from an unknown zero."""
        rng, exact, step = np.random.default_rng(seed), self.exact, 2 * np.pi / 2**bits
        zero = step * rng.uniform(size=exact.position.shape[1])
        position = step * np.round((exact.position - zero) / step) + zero
        force = exact.exact_force + self.noise * rng.normal(size=exact.force.shape)
        return Log.from_arrays(exact.time, position, force, self.robot.actuated)


def coverage(case: Case, bits: int, runs: int) -> dict[str, Any]:
    """Figures of so many logs."""
    covered, errors, cutoffs = [], [], []
    for seed in range(runs):
        recording = prepare_recording(case.robot, case.log(bits, seed))
        fit = quiet_fit(case.model.samples(recording))
        low, high = fit.intervals().T
        covered.append((low <= case.truth) & (case.truth <= high))
        errors.append((fit.values - case.truth) / fit.standard_errors)
        cutoffs.append(recording.cutoff or np.inf)
    rates, z = 100 * np.mean(covered, axis=0), np.array(errors)
    return {
        "parameters": len(case.truth),
        "cut-off (Hz)": float(np.median(cutoffs)),
        "covered %": float(rates.mean()),
        "least %": float(rates.min()),
        "rms error": float(np.sqrt((z**2).mean())),
        "largest mean": float(np.abs(z.mean(axis=0)).max()),
    }


def main() -> None:
    """Print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=200, help="logs of each case")
    parser.add_argument("--robot", choices=list(MOTIONS), help="one robot only")
    parser.add_argument("--rate", type=float, choices=RATES, help="one sample rate only")
    parser.add_argument("--bits", type=int, choices=BITS, help="one encoder only")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    for name, motion in [*((robot, "fourier") for robot in MOTIONS), ("five_bar", "sweep")]:
        for rate in RATES if name != "ur10" else (1000.0,):
            if arguments.robot in (None, name) and arguments.rate in (None, rate):
                case = Case(name, motion, rate)
                for bits in BITS if arguments.bits is None else (arguments.bits,):
                    with one_blas_thread():
                        figures = coverage(case, bits, arguments.runs)
                    head = {"robot": name, "motion": motion, "rate (Hz)": rate, "bits": bits}
                    rows.append(head | figures)
    show(f"95 % intervals from {arguments.runs} logs each", rows)
    if arguments.json:
        write_json(arguments.json, {"intervals": rows})


if __name__ == "__main__":
    main()
