"""Write the robot files of the bank of mechanisms (docs/mechanisms.md) from ``bank.yaml``.

python urdf/generate_bank.py                        # the committed files
python urdf/generate_bank.py --robot 3rrr --out DIR
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bank_plan import Plan
from bank_planar import five_bar, four_bar, planar_3rpr, planar_3rrr
from bank_spatial import delta, hexapod
from generate import HERE, RobotFiles, read_table

TABLE = HERE / "bank.yaml"
BUILDERS: dict[str, Callable[[str, dict[str, Any]], Plan]] = {
    "four_bar": four_bar,
    "parallelogram": four_bar,
    "five_bar": five_bar,
    "3rpr": planar_3rpr,
    "3rrr": planar_3rrr,
    "6ups": hexapod,
    "6ups_crosses": hexapod,
    "delta": delta,
}


def bank_files(name: str, table: dict[str, Any]) -> RobotFiles:
    """The two files of a mechanism from its row of ``bank.yaml``."""
    return BUILDERS[name](name, table).files()


def main() -> None:
    """Write all mechanisms, or one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--robot", choices=list(BUILDERS))
    parser.add_argument("--out", type=Path, default=HERE)
    arguments = parser.parse_args()
    table = read_table(TABLE)
    for name in [arguments.robot] if arguments.robot else BUILDERS:
        bank_files(name, table[name]).write(arguments.out, name)


if __name__ == "__main__":
    main()
