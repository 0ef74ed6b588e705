"""Whether delays of forces are found, undone, and not seen where there are none: a Monte Carlo.

    python benchmarks/delays.py [--runs N] [--robot NAME] [--delay MS ...] [--slip MRAD ...]
                                [--rate HZ] [--seconds S] [--bits N] [--fit]
    python benchmarks/delays.py --plants [--runs N] [--robot NAME] [--delay MS ...] [...]

Each row is a robot with bodies that are some 20 % off its file and with friction, and forces that
are this many ms late: the error of the delay (root mean square, and the part of the logs within 1
ms), half of its 95 % interval, how often that covers it, in which part of the logs a delay is
undone, more than 2 ms are left after that, and how many ms are left at most. A row of 0 ms is of
clean logs: what is undone there is a false alarm. With ``--slip`` friction builds up over this many
mrad after a reversal (Dahl's law, exactly from sample to sample), 0 for friction that jumps.
Motions are those of ``intervals.py``, which repeat after 10 s; seeds draw the noise of the forces.
With ``--fit``, how often intervals of parameters by weighted least squares cover the true values,
too, and the error of recommended fits on another motion.

With ``--plants`` robots are those of ``plants.py``: MuJoCo moves them under PD, fast and slow, and
their friction sticks, or builds up (LuGre).
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

import intervals
import loopid
from intervals import Case
from loopid import identify
from loopid.arguments import FloatArray
from loopid.identification import Delay, find_delay, samples_of
from loopid.identification.force_models import ForceModel
from loopid.logs import Log, Recording
from loopid.workers import one_blas_thread
from plants import DRIVES, Plant, Sensors
from tables import show, write_json

RATE, FINE, BITS = 100.0, 1000.0, 17
LEAD = 0.01  # m that a slide goes in a turn of its motor, which has the encoder
DELAYS = (0.0, 5.0, 10.0, 20.0, 50.0)
CLOSE, FALSE = 1.0, 2.0  # ms
PACES = "fast", "slow"


@dataclass(frozen=True)
class Given:
    """What is asked for."""

    runs: int
    rate: float
    bits: int
    fit: bool


def built_up(position: FloatArray, slip: float) -> FloatArray:
    """Friction (N, m) relative to Coulomb's that builds up over a displacement, by Dahl's law."""
    moved = np.diff(position, axis=0)
    sign, state = np.sign(moved), np.zeros_like(position)
    for k, kept in enumerate(np.exp(-np.abs(moved) / slip)):
        state[k + 1] = sign[k] + (state[k] - sign[k]) * kept
    return state


def exact_force(case: Case, slip: float) -> FloatArray:
    """Forces (N, m) without errors, with friction that builds up over a slip in rad."""
    exact, labels = case.exact, case.model.parameters.labels
    if not slip:
        return exact.exact_force
    coulomb = [case.truth[labels.index(f"{joint}.Fc")] for joint in case.robot.actuated]
    jumps = np.sign(np.gradient(exact.position, axis=0))
    return np.asarray(exact.exact_force + coulomb * (built_up(exact.position, slip) - jumps))


def late_log(case: Case, slip: float, delay: float, seed: int, given: Given) -> Log:
    """A log whose forces are this many s late."""
    rng, exact, robot = np.random.default_rng(seed), case.exact, case.robot
    slides = np.isin(robot.velocity_indices(robot.actuated), robot.prismatic)
    step = np.where(slides, LEAD, 2 * np.pi) / 2**given.bits
    kept = slice(round(FINE / given.rate), None, round(FINE / given.rate))
    force = make_interp_spline(exact.time, exact_force(case, slip), k=3)(exact.time[kept] - delay)
    force += case.noise * rng.normal(size=force.shape)
    zero = step * rng.uniform(size=exact.position.shape[1])
    position = step * np.round((exact.position[kept] - zero) / step) + zero
    return Log.from_arrays(exact.time[kept], position, force, robot.actuated)


def row(model: ForceModel, found: list[Delay], delay: float) -> dict[str, Any]:
    """Figures of delays that were found in logs with one in s."""
    errors = 1e3 * np.array([each.common - delay for each in found])
    halves = 1e3 * np.array([np.ptp(each.interval) / 2 for each in found])
    left = 1e3 * np.array([np.abs(each.undone - delay).max() for each in found])
    undone = np.array([each.clear for each in found])
    return {
        "delay (ms)": 1e3 * delay,
        "error (ms)": float(np.sqrt((errors**2).mean())),
        "within 1 ms %": 100 * float((np.abs(errors) < CLOSE).mean()),
        "± (ms)": float(np.median(halves)),
        "covered %": 100 * float((np.abs(errors) < halves).mean()),
        "undone %": 100 * float(undone.mean()),
        "false %": 100 * float((undone & (left > FALSE)).mean()),
        "left (ms)": float(left.max()),
    }


def fitted(case: Case, recording: Recording, other: Recording) -> tuple[FloatArray, float]:
    """Which intervals (n,) by weighted least squares cover, and the error on another motion."""
    found = identify(loopid.force_model(case.robot, "full"), [recording])
    labels = found.force_model.parameters.labels
    truth = dict(zip(case.model.parameters.labels, case.truth.tolist(), strict=True))
    whole = found["all parameters"].fit
    known = [k for k, label in enumerate(labels) if label in truth]
    low, high = whole.intervals()[known].T
    exact = np.array([truth[labels[k]] for k in known])
    new = samples_of(found.force_model, [other])
    left = np.where(new.used, new.residual(found.fit.values), 0.0)
    sizes = np.where(new.used, new.force, 0.0)
    error = np.linalg.norm(left, axis=0) / np.linalg.norm(sizes, axis=0)
    return (low <= exact) & (exact <= high), float(error.mean())


def simulated(name: str, slips: list[float], delays: list[float], given: Given) -> Iterator[Any]:
    """Rows of a robot on a motion that is known."""
    case, new = Case(name, "fourier", FINE), Case(name, "other", FINE)
    model = loopid.force_model(case.robot, "full")
    for slip in slips:
        other = loopid.prepare(case.robot, late_log(new, slip, 0.0, 1000, given))
        for delay in delays:
            runs = [
                loopid.prepare(case.robot, late_log(case, slip, delay, seed, given))
                for seed in range(given.runs)
            ]
            found = [find_delay(model, [run]) for run in runs]
            figures = row(model, [each for each in found if each is not None], delay)
            if given.fit:
                covered, errors = zip(*(fitted(case, run, other) for run in runs), strict=True)
                figures["parameters covered %"] = 100 * float(np.mean(covered))
                figures["other motion %"] = 100 * float(np.median(errors))
            yield {"robot": name, "builds up over (mrad)": 1e3 * slip} | figures


def moved(name: str, slips: list[float], delays: list[float], given: Given) -> Iterator[Any]:
    """Rows of a robot that MuJoCo moves."""
    for pace in PACES:
        for slip in slips:
            plants = [
                Plant(name=name, seed=seed, bits=given.bits, bristle=slip)
                for seed in range(given.runs)
            ]
            runs = [plant.follow(plant.motion(pace)) for plant in plants]
            model = loopid.force_model(plants[0].robot, "full")
            for delay in delays:
                sensors = Sensors(rate=given.rate, delay=delay)
                logs = (run.log(sensors, seed) for seed, run in enumerate(runs))
                prepared = [loopid.prepare(plants[0].robot, log) for log in logs]
                found = [find_delay(model, [run]) for run in prepared]
                figures = row(model, [each for each in found if each is not None], delay)
                yield {"robot": name, "motion": pace, "builds up over (mrad)": 1e3 * slip} | figures


def main() -> None:
    """Print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=50, help="logs of each case")
    parser.add_argument("--robot", help="one robot only")
    parser.add_argument("--delay", type=float, nargs="+", default=DELAYS, help="in ms")
    parser.add_argument("--slip", type=float, nargs="+", default=[0.0], help="in mrad")
    parser.add_argument("--rate", type=float, default=RATE, help="of the logs in Hz")
    parser.add_argument("--seconds", type=float, default=intervals.SECONDS, help="of each log")
    parser.add_argument("--bits", type=int, default=BITS, help="of encoders, a turn")
    parser.add_argument("--fit", action="store_true", help="what fits are worth, too")
    parser.add_argument("--plants", action="store_true", help="robots that MuJoCo moves")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    intervals.SECONDS = arguments.seconds
    given = Given(arguments.runs, arguments.rate, arguments.bits, arguments.fit)
    delays, slips = ([each / 1e3 for each in own] for own in (arguments.delay, arguments.slip))
    rows: list[dict[str, Any]] = []
    for name in DRIVES if arguments.plants else intervals.ROBOTS:
        if arguments.robot in (None, name):
            with one_blas_thread():
                for figures in (moved if arguments.plants else simulated)(
                    name, slips, delays, given
                ):
                    rows.append(figures)
                    print(figures, flush=True)
    show(f"delays in {arguments.runs} logs each", rows)
    if arguments.json:
        write_json(arguments.json, {"delays": rows})


if __name__ == "__main__":
    main()
