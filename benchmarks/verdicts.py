"""What verdicts say of logs with a mistake, of plants that loopid does not simulate: a Monte Carlo.

    python benchmarks/verdicts.py [--runs N] [--seed N] [--robot NAME ...] [--mistake NAME ...]
                                  [--motion NAME] [--json FILE]

Each row is a mistake of the second motor, of all or of the time axis (``plants.MISTAKES``), or
none: in how many logs the verdict names it first and by its cause, and what was said instead.
``disturbed`` are logs without a mistake of robots with forces that loopid does not model: load
friction, cogging, springs, elastic and Stribeck friction, a longer link. A log that is refused with
a sentence counts as named where the sentence names the cause. Seeds draw bodies, motions, encoders
of 12 to 17 bits, rates of 100 Hz to 1 kHz and 0.3 to 5 % of noise.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import loopid
from loopid import read_log
from loopid.errors import LoopidError
from loopid.files import csv_text
from loopid.identification import log_faults
from loopid.logs import Log
from loopid.robot import Robot
from loopid.workers import one_blas_thread
from plants import DRIVES, MISTAKES, PACES, Plant, Sensors
from tables import show, write_json

BITS, RATES, NOISE = (17, 14, 12, 15), (100.0, 200.0, 500.0, 1000.0), (0.01, 0.003, 0.02, 0.05)
DISTURBED: tuple[dict[str, float], ...] = (
    {"load": 0.1},
    {"cogging": 0.3},
    {"spring": 2.0},
    {"bristle": 0.002},
    {"length": 0.02},
    {"stribeck": 0.5},
)
# What is said of the second motor, of the first two, or of all.
SIGN = "has the wrong sign"
SAID = {
    "sign of a force": "the force of {1} " + SIGN,
    "sign of all forces": "the force of all motors " + SIGN,
    "half a force": "the force of {1} is scaled by 0.",
    "a force in N cm": "the force of {1} is in N cm",
    "all in mN m": "the force of all motors is in mN m",
    "all times 100": "the force of all motors is in N cm",
    "exchanged forces": "the forces of {0} and {1} are exchanged",
    "exchanged positions": "the positions of {0} and {1} are exchanged",
    "exchanged motors": "the positions and forces of {0} and {1} are exchanged",
    "positions times 2": "the positions of {1} are ",
    "sign of positions": "the positions of {1} have the wrong sign",
    "a position in degrees": "deg to rad",
    "positions in degrees": "deg to rad",
    "zero of an encoder": "zero of {1} is off",
    "time times 2": "times too long",
    "time over 10": "times too short",
    "forces 7 s late": "the forces are 7",
    "forces 0.5 s late": "s late",
}
# Motors that are alike may be exchanged: that is another way of counting them. Forces of motors
# that are exchanged are as good as positions that are.
ALIKE = {"exchanged motors": ("delta",)}
ALSO = {"exchanged positions": "exchanged", "exchanged forces": "exchanged"}


def first_said(robot: Robot, log: Log) -> str:
    """The mistake that the verdict begins with, or why the log is refused; empty if neither."""
    names = [f"{joint}.{what}" for what in ("position", "force") for joint in log.joints]
    try:
        with TemporaryDirectory() as folder:
            file = Path(folder, "run.csv")
            file.write_text(csv_text(["time", *names], log.time, log.position, log.force))
            read = read_log(file, robot)
        found = log_faults(robot, [loopid.prepare(robot, read)]).mistakes
    except LoopidError as error:
        return f"refused: {error}"
    return next((each.title for each in found if each.severity == "mistake"), "")


@dataclass
class Row:
    """Counts of one mistake."""

    logs: int = 0
    named: int = 0
    others: Counter[str] = field(default_factory=Counter)

    def count(self, said: str, words: str) -> None:
        """Add a log of which something was said, and what should have been."""
        self.logs += 1
        right = words in said if words else not said
        self.named += right
        if said and not right:
            self.others[said[:60]] += 1


def main() -> None:
    """Print a table, and write the figures on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=20, help="logs of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first log")
    parser.add_argument("--robot", choices=list(DRIVES), nargs="+", default=list(DRIVES))
    parser.add_argument("--motion", choices=[*PACES, "stops"], default="fast")
    names = ["none", "disturbed", *SAID]
    parser.add_argument("--mistake", choices=names, nargs="+", default=names)
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows: dict[tuple[str, str], Row] = defaultdict(Row)
    for robot in arguments.robot:
        for seed in range(arguments.seed, arguments.seed + arguments.runs):
            with one_blas_thread():
                _count(rows, robot, seed, arguments)
    table: list[dict[str, Any]] = [
        {"robot": robot, "mistake": mistake, "named first": f"{row.named} of {row.logs}"}
        | {"said instead": "; ".join(f"{n} x {said}" for said, n in row.others.most_common(2))}
        for (robot, mistake), row in rows.items()
    ]
    show(f"verdicts on logs with mistakes, {arguments.motion} motion", table)
    if arguments.json:
        write_json(arguments.json, {"verdicts": table})


def _count(rows: dict[tuple[str, str], Row], robot: str, seed: int, asked: Any) -> None:
    """The rows of one robot with one seed."""
    bits, sensors = BITS[seed % 4], Sensors(rate=RATES[seed % 4], noise=NOISE[seed // 4 % 4])
    clean = [each for each in asked.mistake if each != "disturbed"]
    if clean:
        plant = Plant(name=robot, seed=seed, bits=bits)
        log = plant.follow(plant.motion(asked.motion)).log(sensors, seed)
        motors = plant.robot.actuated
        for mistake in clean:
            if robot in ALIKE.get(mistake, ()):
                continue
            spoilt = MISTAKES[mistake](log) if mistake != "none" else log
            words = ALSO.get(mistake, SAID.get(mistake, "")).format(*motors)
            rows[robot, mistake].count(first_said(plant.robot, spoilt), words)
    if "disturbed" in asked.mistake:
        disturbed = Plant(name=robot, seed=seed, bits=bits, **DISTURBED[seed % len(DISTURBED)])
        run = disturbed.follow(disturbed.motion(asked.motion))
        rows[robot, "disturbed"].count(first_said(disturbed.robot, run.log(sensors, seed)), "")


if __name__ == "__main__":
    main()
