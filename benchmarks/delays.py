"""Whether delays of forces are found, undone, and not seen in clean logs: a Monte Carlo.

    python benchmarks/delays.py [--runs N] [--robot NAME] [--delay MS ...] [--seconds S] [--bits N]

Each row is a robot with bodies that are some 20 % off its file and with friction, on one motion of
100 Hz that repeats after 10 s, and forces that are so many ms late: the error of the delay (root
mean square, and the part of the logs within 1 ms), half of its 95 % interval, how often that covers
it, in which part of the logs it is undone, and how often intervals of parameters by weighted least
squares cover the true values after it. A row of 0 ms is of clean logs: what is undone there is a
false alarm. Cases are those of ``intervals.py``; seeds draw the noise of the forces.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

import intervals
from intervals import Case
from loopid import identify, prepare_recording
from loopid.logs import Log
from loopid.workers import one_blas_thread
from tables import show, write_json

RATE, FINE, BITS = 100.0, 1000.0, 17
LEAD = 0.01  # m that a slide goes in a turn of its motor, which has the encoder
DELAYS = (0.0, 5.0, 10.0, 20.0, 50.0)
CLOSE = 1.0  # ms


def late_log(case: Case, delay: float, seed: int, bits: int = BITS) -> Log:
    """A log of 100 Hz whose forces are so many s late."""
    rng, exact, robot = np.random.default_rng(seed), case.exact, case.robot
    slides = np.isin(robot.velocity_indices(robot.actuated), robot.prismatic)
    step = np.where(slides, LEAD, 2 * np.pi) / 2**bits
    kept = slice(round(FINE / RATE), None, round(FINE / RATE))
    force = make_interp_spline(exact.time, exact.exact_force, k=3)(exact.time[kept] - delay)
    force += case.noise * rng.normal(size=force.shape)
    zero = step * rng.uniform(size=exact.position.shape[1])
    position = step * np.round((exact.position[kept] - zero) / step) + zero
    return Log.from_arrays(exact.time[kept], position, force, robot.actuated)


def figures(case: Case, delay: float, runs: int, bits: int) -> dict[str, Any]:
    """Figures of so many logs with a delay in s."""
    errors, halves, undone, covered = [], [], [], []
    for seed in range(runs):
        log = late_log(case, delay, seed, bits)
        found = identify(case.model, [prepare_recording(case.robot, log)])
        assert found.delay is not None
        errors.append(1e3 * (found.delay.common - delay))
        halves.append(1e3 * np.ptp(found.delay.interval) / 2)
        undone.append(found.delay.clear)
        low, high = found["all parameters"].fit.intervals().T
        covered.append((low <= case.truth) & (case.truth <= high))
    off, half = np.abs(errors), np.array(halves)
    return {
        "delay (ms)": 1e3 * delay,
        "error (ms)": float(np.sqrt((off**2).mean())),
        "within 1 ms %": 100 * float((off < CLOSE).mean()),
        "± (ms)": float(np.median(half)),
        "covered %": 100 * float((off < half).mean()),
        "undone %": 100 * float(np.mean(undone)),
        "parameters covered %": 100 * float(np.mean(covered)),
    }


def main() -> None:
    """Print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=50, help="logs of each case")
    parser.add_argument("--robot", choices=list(intervals.ROBOTS), help="one robot only")
    parser.add_argument("--delay", type=float, nargs="+", default=DELAYS, help="in ms")
    parser.add_argument("--seconds", type=float, default=intervals.SECONDS, help="of each log")
    parser.add_argument("--bits", type=int, default=BITS, help="of encoders, a turn")
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    intervals.SECONDS = arguments.seconds
    rows = []
    for name in intervals.ROBOTS:
        if arguments.robot in (None, name):
            case = Case(name, "fourier", FINE)
            for delay in arguments.delay:
                with one_blas_thread():
                    rows.append(
                        {"robot": name} | figures(case, delay / 1e3, arguments.runs, arguments.bits)
                    )
    show(f"delays in {arguments.runs} logs of {arguments.seconds:g} s each", rows)
    if arguments.json:
        write_json(arguments.json, {"delays": rows})


if __name__ == "__main__":
    main()
