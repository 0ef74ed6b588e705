"""How many files and functions of loopid a call passes through, and how often it changes files.

    python benchmarks/calls.py [--json FILE]

Counted by ``sys.setprofile``: functions of loopid that run, the files they stand in, and the calls
(and generators that go on) whose caller stands in another file of loopid. Imports are not counted.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import loopid
from loopid.__main__ import main as command
from tables import show, write_json

SOURCE = str(Path(loopid.__file__).parent)
LOG = Path(__file__).parents[1] / "urdf" / "logs" / "five_bar.csv"
CALLS: dict[str, list[str] | Callable[[], object]] = {
    "loopid base 3ups_rpu": ["base", "3ups_rpu"],
    'load_mechanism("3ups_rpu")': lambda: loopid.load_mechanism("3ups_rpu"),
    "loopid identify five_bar LOG --model full": [
        "identify",
        "five_bar",
        str(LOG),
        "--model",
        "full",
    ],
}


def main() -> None:
    """Print the table and write it on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    rows = []
    for name, call in CALLS.items():
        run = call if callable(call) else partial(_command, call)
        run()  # imports and caches
        rows.append({"call": name, **passed(run)})
    show("what a call passes through", rows)
    if arguments.json:
        write_json(arguments.json, {"calls": rows})


def passed(call: Callable[[], object]) -> dict[str, Any]:
    """Files, functions and moves between files of one call."""
    functions, moves = set[tuple[str, str, int]](), 0

    def note(frame: FrameType, event: str, _: object) -> None:
        nonlocal moves
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(SOURCE):
            return
        functions.add((code.co_filename, code.co_qualname, code.co_firstlineno))
        caller = frame.f_back
        while caller is not None and not caller.f_code.co_filename.startswith(SOURCE):
            caller = caller.f_back
        moves += caller is not None and caller.f_code.co_filename != code.co_filename

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sys.setprofile(note)
        try:
            call()
        finally:
            sys.setprofile(None)
    files = {file for file, _, _ in functions}
    return {"files": len(files), "functions": len(functions), "moves between files": moves}


def _command(words: list[str]) -> None:
    """One command, its output thrown away."""
    with Path(os.devnull).open("w") as nowhere:
        before, sys.stdout, sys.argv = sys.stdout, nowhere, ["loopid", *words]
        try:
            command()
        except SystemExit:
            pass
        finally:
            sys.stdout = before


if __name__ == "__main__":
    main()
