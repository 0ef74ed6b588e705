"""The URDFs of the package example-robot-data, for benchmarks on others' robots."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

FOLDER = "share/example-robot-data/robots"


def robots_folder() -> Path:
    """The installed folder of robots; ends the program with what to install where it is missing."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        raise SystemExit("needs example-robot-data: pip install 'loopid[test]'") from None
    for file in files:
        path = Path(str(file.locate()))
        if FOLDER in path.as_posix():
            before, _, _ = path.as_posix().partition(FOLDER)
            return Path(before) / FOLDER
    raise SystemExit("example-robot-data is installed without its robots")


def distinct_urdfs() -> dict[str, Path]:
    """All URDFs by name, those with the very same bytes once, the smaller files first.

    A name that two files share is preceded by the robot's folder.
    """
    found = sorted(robots_folder().rglob("*.urdf"), key=lambda file: (file.stat().st_size, file))
    files = list({file.read_bytes(): file for file in reversed(found)}.values())[::-1]
    stems = [file.stem for file in files]
    return {
        file.stem if stems.count(file.stem) == 1 else f"{_folder(file)}/{file.stem}": file
        for file in files
    }


def _folder(file: Path) -> str:
    return file.relative_to(robots_folder()).parts[0]
