"""False alarms of ``loopid.diagnose`` in clean logs, and mistakes that it finds: a Monte Carlo.

    python benchmarks/suspicions.py [--runs N] [--seed N] [--robot NAME] [--mistake NAME ...]

Each row is a robot with bodies that are some 20 % off its file and with friction, whose logs hold a
mistake of the second motor, of all or of the time axis, or none: in which part of the logs the
mistake is named first, and in which anything else is. Delays that are undone count as named. Cases
are those of ``intervals.py`` at 100 Hz with encoders of 10 to 17 bit; seeds draw zeros and noise.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from intervals import MOTIONS, Case
from loopid import find_delay, prepare_recording
from loopid.diagnosis import suspicions
from loopid.logs import Log
from loopid.workers import one_blas_thread
from tables import show, write_json

RATE, BITS = 100.0, (17, 14, 12, 10)


def times(factor: float, column: int | slice = 1) -> Callable[[Log], Log]:
    """Forces times a factor."""

    def spoilt(log: Log) -> Log:
        force = log.force.copy()
        force[:, column] *= factor
        return replace(log, force=force)

    return spoilt


def geared(ratio: float) -> Callable[[Log], Log]:
    """Positions of the second motor times a ratio."""

    def spoilt(log: Log) -> Log:
        position = log.position.copy()
        position[:, 1] *= ratio
        return replace(log, position=position)

    return spoilt


def exchanged(what: str) -> Callable[[Log], Log]:
    """Positions or forces of the first two motors exchanged."""

    def spoilt(log: Log) -> Log:
        values = getattr(log, what).copy()
        values[:, :2] = values[:, 1::-1]
        return replace(log, **{what: values})

    return spoilt


# What is done to a log, and what is said of it.
MISTAKES: dict[str, tuple[Callable[[Log], Log], str]] = {
    "none": (lambda log: log, ""),
    "sign of a force": (times(-1.0), "the force of"),
    "half a force": (times(0.5), "the force of"),
    "all in mN m": (times(1e3, slice(None)), "all forces"),
    "exchanged forces": (exchanged("force"), "look exchanged"),
    "exchanged positions": (exchanged("position"), "look exchanged"),
    "positions times 2": (geared(2.0), "the positions of"),
    "sign of positions": (geared(-1.0), "the positions of"),
    "time times 2": (lambda log: replace(log, time=2 * log.time), "the time axis"),
    "time over 10": (lambda log: replace(log, time=log.time / 10), "the time axis"),
}


def figures(case: Case, mistake: str, seeds: range) -> dict[str, Any]:
    """Figures of a log a seed with a mistake."""
    spoilt, words = MISTAKES[mistake]
    named, others = 0, 0
    for seed in seeds:
        log = spoilt(case.log(BITS[seed % len(BITS)], seed))
        recording = prepare_recording(case.robot, log)
        said = list(suspicions(case.robot, [recording]).sentences)
        if not words:
            delay = find_delay(case.model, [recording])
            said += [delay.sentence] if delay is not None and delay.clear else []
        found = bool(words and said and words in said[0])
        named, others = named + found, others + (len(said) > found)
    shares = (100 * count / len(seeds) for count in (named, others))
    return {"mistake": mistake, **dict(zip(("named %", "other %"), shares, strict=True))}


def main() -> None:
    """Print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=20, help="logs of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first log")
    parser.add_argument("--robot", choices=list(MOTIONS), help="one robot only")
    parser.add_argument("--mistake", choices=list(MISTAKES), nargs="+", default=list(MISTAKES))
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    seeds, rows = range(arguments.seed, arguments.seed + arguments.runs), []
    for name in MOTIONS:
        if arguments.robot in (None, name):
            case = Case(name, "fourier", RATE)
            for mistake in arguments.mistake:
                with one_blas_thread():
                    rows.append({"robot": name} | figures(case, mistake, seeds))
    show(f"suspicions of {arguments.runs} logs each", rows)
    if arguments.json:
        write_json(arguments.json, {"suspicions": rows})


if __name__ == "__main__":
    main()
