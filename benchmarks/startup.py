"""Processor time of whole commands, and the modules that each imports.

    python benchmarks/startup.py [--runs N] [--json FILE]

Each command runs in a process of its own with one BLAS thread; the least of the runs counts.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from tempfile import TemporaryDirectory
from typing import Any

from loopid.loading.files import bundled_directory
from tables import show, write_json

# Runs a command, and says how many modules there are at its end.
COUNTED = """
import sys
from loopid.__main__ import main
try:
    main()
except SystemExit:
    pass
print(*map(sum, zip(*((1, m.startswith("loopid")) for m in sys.modules))), file=sys.stderr)
"""


def main() -> None:
    """Print the table and write it on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    options = parser.parse_args()
    log = str(bundled_directory() / "logs" / "five_bar.csv")
    rows = []
    with TemporaryDirectory() as folder:
        for words in (
            ["--help"],
            ["check", "five_bar"],
            ["base", "five_bar"],
            ["identify", "five_bar", log, "--out", folder],
        ):
            runs = [run(words) for _ in range(options.runs)]
            rows.append(min(runs, key=lambda row: row["seconds"]))
    show("Commands, in processor time", rows)
    if options.json:
        write_json(options.json, {"commands": rows})


def run(words: list[str]) -> dict[str, Any]:
    """A command's processor time and modules."""
    before = os.times()
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", COUNTED, *words], capture_output=True, text=True, env=environment
    )
    after = os.times()
    spent = after.children_user - before.children_user
    spent += after.children_system - before.children_system
    modules, own = map(int, done.stderr.split()[-2:])
    name = " ".join(words[:2])
    return {"command": name, "seconds": spent, "modules": modules, "of_loopid": own}


if __name__ == "__main__":
    main()
