"""False alarms of ``loopid.identification.log_faults``, and mistakes that it finds: a Monte Carlo.

    python benchmarks/log_faults.py [--runs N] [--seed N] [--robot NAME] [--mistake NAME ...]

Each row is a robot with bodies that are some 20 % off its file and with friction, whose logs hold a
mistake of the second motor, of all or of the time axis, or none: in which part of the logs the
mistake is named first, and in which anything else is. Delays that are undone count as named. Cases
are those of ``intervals.py`` at 100 Hz with encoders of 10 to 17 bit; seeds draw zeros and noise.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import loopid
from intervals import MOTIONS, Case
from loopid.identification import find_delay, log_faults
from loopid.workers import one_blas_thread
from plants import MISTAKES
from tables import show, write_json

RATE, BITS = 100.0, (17, 14, 12, 10)


# What is said of a mistake of a log; nothing of none.
SAID = {
    "none": "",
    "sign of a force": "the force of",
    "half a force": "the force of",
    "all in mN m": "the force of all motors",
    "exchanged forces": "are exchanged",
    "exchanged positions": "are exchanged",
    "positions times 2": "the positions of",
    "sign of positions": "the positions of",
    "time times 2": "the time axis",
    "time over 10": "the time axis",
}


def figures(case: Case, mistake: str, seeds: range) -> dict[str, Any]:
    """Figures of a log a seed with a mistake."""
    words = SAID[mistake]
    named, others = 0, 0
    for seed in seeds:
        log = case.log(BITS[seed % len(BITS)], seed)
        if words:
            log = MISTAKES[mistake](log)
        recording = loopid.prepare(case.robot, log)
        said = [found.title for found in log_faults(case.robot, [recording]).mistakes]
        if not words:
            delay = find_delay(case.model, [recording])
            said += [] if delay is None else [each.why for each in delay.findings]
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
    parser.add_argument("--mistake", choices=list(SAID), nargs="+", default=list(SAID))
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
    show(f"faults of {arguments.runs} logs each", rows)
    if arguments.json:
        write_json(arguments.json, {"log_faults": rows})


if __name__ == "__main__":
    main()
