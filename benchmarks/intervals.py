"""Whether 95 % intervals from noisy logs hold with default options: a Monte Carlo with known truth.

    python benchmarks/intervals.py [--runs N] [--robot NAME] [--rate HZ] [--bits N]
    python benchmarks/intervals.py --filter [--kind KIND] [--latin] [--panda LOG] [...]

Each row is a robot with bodies that are some 20 % off its file and with friction, on one motion, at
a sample rate and with encoders of some bits a turn: the cut-off that the log asks for, how often
intervals of all parameters by weighted least squares cover the true values, on average over the
parameters and for the worst, and the root mean square and the largest mean of errors in standard
errors: 1 and 0 where all is well. Seeds draw the noise of the forces and the phases of the
encoders.

With ``--filter`` the chosen cut-off beside fixed ones, for white noise, stamps that jitter by 20 %
of a sample, rows that are held for 2 to 10 samples, and positions low-passed at 100 Hz: in how many
logs the squared error of all parameters on another motion is within 1.5 times that of the best
fixed cut-off (of the cell, in the same log), the largest ratio, the ratio of the means, and how
often recommended intervals cover. ``--latin`` takes four cells a robot, with each rate, encoder and
kind of noise once. ``--panda`` is a log of that robot: errors of each joint on the last 40 %, below
10 Hz, over the least of fixed cut-offs.
"""

from __future__ import annotations

import argparse
import warnings
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import loopid
from example_robots import robots_folder
from loopid import FilterOptions, JointTerms, identify, read_log
from loopid.arguments import FloatArray
from loopid.identification import ForceModel, choose_cutoff, split_recordings
from loopid.identification.fitting import quiet_fit
from loopid.kinematics import platform_coordinates
from loopid.logs import Log
from loopid.logs.preparing import prepare_again
from loopid.motion import (
    FourierSeries,
    LowPass,
    Motion,
    joint_motion,
    read_motion_program,
    scaled_bodies,
)
from loopid.motion.simulation import Measurement
from loopid.workers import one_blas_thread
from tables import show, write_json

UR10 = "ur_description/urdf/ur10_robot.urdf"
RATES, BITS = (100.0, 500.0, 1000.0, 5000.0), (17, 20)
KINDS, COARSE = ("white", "jitter", "held", "low-passed"), (10, 12, 14, 17)
# Of stamps, in samples; samples that are held; of the driver's filter of positions (Hz).
JITTER, HELD, DRIVER = 0.2, (2, 10), 100.0
# Fixed cut-offs (Hz), and the ratio of squared errors that passes.
FIXED, PASSES = 0.98 * 1.4 ** np.arange(12), 1.5
PANDA, FINGERS = "panda_description/urdf/panda.urdf", ("panda_finger_joint1", "panda_finger_joint2")
PANDA_JUDGED = 10.0  # Hz
CAD_ERROR = 0.2
HARMONICS, FREQUENCY, SECONDS = 5, 0.1, 20.0
UR10_FRICTION = np.concatenate([np.tile([8.0, 10.0], 3), np.tile([2.0, 1.5], 3)])
# Middle and size (rad, m) of the Fourier series; Coulomb and viscous friction; noise of the forces.
ROBOTS: dict[str, tuple[tuple[float, ...] | None, Any, Any, Any]] = {
    "five_bar": (None, 0.25, (0.1, 0.05), 0.02),
    "delta": (None, 0.2, (0.1, 0.05), 0.02),
    "ur10": (
        (0.0, -1.2, 1.2, 0.0, 0.5, 0.0),
        0.5,
        UR10_FRICTION,
        np.array([2.0, 3.0, 2.0, 0.5, 0.5, 0.5]),
    ),
    "3ups_rpu": (None, np.array([0.02, 0.015, 0.07, 0.07]), (20.0, 400.0), 2.0),  # its platform
}
MOTIONS = ("five_bar", "delta", "ur10")


class Case:
    """A robot on a motion at a rate: its force model, true values (n,), and what sensors read."""

    def __init__(self, name: str, motion: str, rate: float) -> None:
        self.name, self.rate = name, rate
        file = str(Path(robots_folder()) / UR10) if name == "ur10" else name
        self.robot = loopid.load(file)
        m, (_, _, friction, noise) = len(self.robot.actuated), ROBOTS[name]
        friction = np.resize(np.asarray(friction, dtype=float), 2 * m)
        self.noise = np.broadcast_to(noise, m)
        terms = JointTerms(self.robot.actuated, ("Fc", "Fv"))
        self.model: ForceModel = loopid.force_model(self.robot, "full", terms)
        bodies = scaled_bodies(self.robot, CAD_ERROR)
        self.truth = self.model.base.values(np.concatenate([bodies, friction]))
        moved = joint_motion(self.robot, self.planned(name, motion, rate))
        self.exact: Measurement = loopid.simulate(
            self.robot,
            moved,
            standard_parameters=bodies,
            joint_terms=terms,
            joint_values=friction,
        )

    def planned(self, name: str, motion: str, rate: float) -> Motion:
        """The bundled motion, with stops, or a Fourier series."""
        if motion not in ("fourier", "other"):
            return read_motion_program(name).motion(motion, rate)
        middle, size, *_ = ROBOTS[name]
        robot, names = self.robot, self.robot.actuated
        if np.ndim(size) and robot.platform is not None:
            names = robot.platform.names
            middle = platform_coordinates(robot, robot.reference[None])[0]
        elif middle is None:
            middle = tuple(robot.reference[robot.joint(joint).idx_q] for joint in names)
        sizes = np.multiply.outer(size, 1 / np.arange(1, HARMONICS + 1))
        sine, cosine = (
            np.random.default_rng(77 * (motion == "other")).normal(size=(2, len(middle), HARMONICS))
            * sizes
        )
        series = FourierSeries(names, FREQUENCY, np.array(middle), sine, cosine)
        return series.motion(rate=rate, duration=SECONDS)

    def log(self, bits: int, seed: int, kind: str = "white") -> Log:
        """A log with noise of forces, and positions in steps from an unknown zero."""
        rng, exact, step = np.random.default_rng(seed), self.exact, 2 * np.pi / 2**bits
        zero = step * rng.uniform(size=exact.position.shape[1])
        position = step * np.round((exact.position - zero) / step) + zero
        force = exact.exact_force + self.noise * rng.normal(size=exact.force.shape)
        time = np.array(exact.time)
        step = float(time[1] - time[0])
        if kind == "jitter":
            time += JITTER * step * np.clip(rng.normal(size=len(time)), -2.0, 2.0)
        elif kind == "held":
            count = int(rng.integers(HELD[0], HELD[1] + 1))
            rows = np.arange(len(time)) // count * count
            position, force = position[rows], force[rows]
        elif kind == "low-passed":
            position = LowPass(DRIVER).apply(position, 1.0 / step)
        return Log.from_arrays(time, position, force, self.robot.actuated)


def coverage(case: Case, bits: int, runs: int) -> dict[str, Any]:
    """Figures of this many logs."""
    covered, errors, cutoffs = [], [], []
    for seed in range(runs):
        recording = loopid.prepare(case.robot, case.log(bits, seed))
        choice = choose_cutoff(case.model, [recording])
        if choice is not None:
            (recording,) = prepare_again(case.robot, [recording], cutoff=choice.chosen)
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


def filtered(case: Case, bits: int, kind: str, runs: int) -> dict[str, Any]:
    """Figures of this many logs, with the chosen cut-off beside fixed ones."""
    new = case.model.regressor(joint_motion(case.robot, case.planned(case.name, "other", 50.0)))
    size = ((new @ case.truth) ** 2).mean(axis=0)

    def error(values: FloatArray) -> float:
        return float((((new @ (values - case.truth)) ** 2).mean(axis=0) / size).mean())

    chosen, fixed, cutoffs, covered = [], [], [], []
    rates = FIXED[case.rate / 5 >= FIXED]
    for seed in range(runs):
        log = case.log(bits, seed, kind)
        recording = loopid.prepare(case.robot, log)
        found = identify(case.model, [recording], validation=[recording])
        low, high = found.fit.intervals().T
        covered.append(np.mean((low <= case.truth) & (case.truth <= high)))
        cutoffs.append(found.training[0].cutoff or np.inf)
        chosen.append(error(found["all parameters"].fit.values))
        options = (FilterOptions(cutoff=float(cutoff)) for cutoff in rates)
        runs_at = (loopid.prepare(case.robot, log, filter=each) for each in options)
        fixed.append([error(quiet_fit(case.model.samples(run)).values) for run in runs_at])
    best = int(np.mean(fixed, axis=0).argmin())
    least = np.array(fixed)[:, best]
    ratio = np.array(chosen) / least
    return {
        "best (Hz)": float(rates[best]),
        "chosen (Hz)": float(np.median(cutoffs)),
        "error %": 100 * float(np.sqrt(np.mean(chosen))),
        "within 1.5 %": 100 * float((ratio <= PASSES).mean()),
        "largest": float(ratio.max()),
        "ratio of means": float(np.mean(chosen) / least.mean()),
        "covered %": 100 * float(np.mean(covered)),
    }


def panda(path: str) -> list[dict[str, Any]]:
    """Errors (N m) of the joints of a real log by cut-off, and their largest ratio to the best."""
    if not Path(path).exists():
        print(f"no log {path}: skipped")
        return []
    robot = loopid.load(str(Path(robots_folder()) / PANDA), lock=FINGERS)
    log = read_log(path, robot)
    model = loopid.force_model(robot, "full", JointTerms(robot.actuated, ("Fc", "Fv", "Fo")))
    runs = {"default": loopid.prepare(robot, log)}
    runs |= {
        f"{cutoff:.2f}": loopid.prepare(robot, log, filter=FilterOptions(cutoff=float(cutoff)))
        for cutoff in FIXED
    }
    judging = loopid.prepare(robot, log, filter=FilterOptions(cutoff=PANDA_JUDGED))
    _, (new,) = split_recordings([judging])
    problem = model.samples(new).problem
    errors, cutoffs = {}, {}
    for name, run in runs.items():
        found = identify(model, [run])
        cutoffs[name] = found.training[0].cutoff
        squares = problem.residual_squares(found["all parameters"].fit.values)
        errors[name] = np.sqrt(squares / problem.samples)
    fixed = [name for name in runs if name != "default"]
    best = min(fixed, key=lambda name: float((errors[name] ** 2 / problem.force_rms**2).sum()))
    return [
        {"cut-off (Hz)": cutoffs[name]}
        | {f"J{k + 1}": float(value) for k, value in enumerate(errors[name])}
        | {"largest ratio": float((errors[name] / errors[best]).max())}
        for name in runs
    ]


def filter_cells(arguments: argparse.Namespace) -> list[tuple[str, float, int, str]]:
    """Cells of the grid of robots, rates, encoders and kinds of noise that were asked for."""
    count = len(RATES)
    return [
        (name, RATES[k], COARSE[i], KINDS[j])
        for r, name in enumerate(MOTIONS)
        for k, i, j in product(range(count), repeat=3)
        if arguments.robot in (None, name)
        and arguments.rate in (None, RATES[k])
        and arguments.bits in (None, COARSE[i])
        and arguments.kind in (None, KINDS[j])
        and (KINDS[j] != "low-passed" or RATES[k] > 2 * DRIVER)
        and not (arguments.latin and (i, j) != ((r - k) % count, (r + k) % count))
    ]


def filters(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """A row a cell."""
    rows: list[dict[str, Any]] = []
    for name, rate, bits, kind in filter_cells(arguments):
        with one_blas_thread():
            figures = filtered(Case(name, "fourier", rate), bits, kind, arguments.runs)
        head = {"robot": name, "rate (Hz)": rate, "bits": bits, "noise": kind}
        rows.append(head | figures)
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=200, help="logs of each case")
    parser.add_argument("--robot", choices=list(MOTIONS), help="one robot only")
    parser.add_argument("--rate", type=float, choices=RATES, help="one sample rate only")
    parser.add_argument("--bits", type=int, help="one encoder only")
    parser.add_argument("--filter", action="store_true", help="the chosen cut-off, beside fixed")
    parser.add_argument("--kind", choices=KINDS, help="of noise, one only")
    parser.add_argument("--latin", action="store_true", help="four cells a robot")
    parser.add_argument("--panda", metavar="LOG", help="a real log of a Panda")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    if arguments.filter:
        rows = panda(arguments.panda) if arguments.panda else filters(arguments)
        show(f"cut-offs, {arguments.runs} logs each", rows)
        if arguments.json:
            write_json(arguments.json, {"filter": rows})
        return
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
