"""Fuzz the command line: ``python tests/reliability/fuzz.py --calls 2000 [--seed 0]``.

Every call must end with exit code 0, or 2 and one sentence; with no traceback, no half-written
file and nothing left among the temporary files. A call can be repeated by its number: ``--only``.
"""

import argparse
import os
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from unittest.mock import patch

import beside_tests  # noqa: F401
from fuzz_calls import calls
from fuzz_judging import faults
from fuzz_material import Material
from fuzz_running import clear, run

from loopid.paper import reproduce


def small_paper(stack: ExitStack) -> None:
    """Let the paper be reproduced from few samples."""
    stack.enter_context(patch.object(reproduce, "RATE", 2.0))
    stack.enter_context(patch.object(reproduce, "COVERAGE_RATE", 0.2))
    few = partial(reproduce.reproduce_paper, repetitions=3)
    stack.enter_context(patch("loopid.cli.paper.reproduce_paper", few))


def fuzz(folder: Path, numbers: range, seed: int = 0, report=None) -> dict[str, list[str]]:
    """Run calls; faults by command line."""
    found: dict[str, list[str]] = {}
    material = Material(folder)
    material.logs, material.mapping, material.motions, material.fit  # noqa: B018
    work = folder / "work"
    work.mkdir()
    with ExitStack() as stack:
        small_paper(stack)
        stack.callback(os.chdir, Path.cwd())
        os.chdir(work)
        for call in calls(material, seed, numbers):
            outcome = run(call, folder)
            wrong = faults(call, outcome)
            if wrong:
                found[f"{call.number}: loopid {' '.join(map(repr, call.words))}"] = wrong
            if report is not None:
                report(call, outcome, wrong)
            clear(call)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, help="Number of a single call.")
    parser.add_argument("--log", type=Path, help="Write what each call answered to a file.")
    given = parser.parse_args()
    numbers = range(given.calls) if given.only is None else range(given.only, given.only + 1)
    codes, start, answers = Counter(), time.perf_counter(), []

    def report(call, outcome, wrong) -> None:
        codes[call.words[0] if call.words else "", outcome.code] += 1
        said = (outcome.errors or outcome.err.splitlines()[-1:] or [""])[0]
        seconds = time.perf_counter() - start
        answers.append(f"{call.number} {seconds:.1f} {outcome.code} {call.words!r}: {said}\n")
        for fault in wrong:
            answers.append(f"    FAULT {fault}\n")
            sys.stdout.write(f"{call.number}: {call.words!r:.300}\n    {fault}\n")
        if given.log is not None:
            given.log.write_text("".join(answers), errors="backslashreplace")

    with tempfile.TemporaryDirectory() as folder:
        found = fuzz(Path(folder), numbers, given.seed, report)
    for (command, code), count in sorted(codes.items()):
        sys.stdout.write(f"{command!r:.20}: exit code {code} in {count} calls\n")
    sys.stdout.write(f"{len(found)} of {len(numbers)} calls broke a promise\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
