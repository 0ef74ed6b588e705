"""Robot files, and motions of these robots, that come with the package."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from loopid.errors import MissingFileError, RobotFileError
from loopid.files import why_no_file

SUFFIXES = (".yaml", ".yml", ".urdf", ".xml", ".mjcf")
MOTIONS = "_motions.yaml"


def bundled_directory() -> Path:
    """Folder of the bundled robots: in the installed package, or in the checkout."""
    installed = Path(str(files("loopid"))) / "urdf"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "urdf"


def bundled_robots() -> tuple[str, ...]:
    """Names of the bundled robots, to be given to ``load_mechanism``."""
    directory = bundled_directory()
    urdfs = sorted(file.stem for file in directory.glob("*.urdf"))
    return tuple(name for name in urdfs if (directory / f"{name}.yaml").is_file())


def find_robot_file(path: str | Path) -> Path:
    """An existing robot file: the path itself, or a bundled robot's name."""
    file = Path(path)
    problem = why_no_file(file)
    if not problem:
        if file.suffix not in SUFFIXES:
            raise RobotFileError(f"{file}: a robot file ends in {', '.join(SUFFIXES)}")
        return file
    if str(path) in bundled_robots():
        return bundled_directory() / f"{path}.yaml"
    listed = ", ".join(bundled_robots())
    raise MissingFileError(f"{file} {problem}, and the bundled robots are: {listed}")


def find_motion_file(path: str | Path) -> Path:
    """An existing motion file: the path itself, or the bundled one of a robot's name."""
    file = Path(path)
    problem = why_no_file(file)
    if not problem:
        return file
    bundled = {
        found.name.removesuffix(MOTIONS): found
        for found in sorted(bundled_directory().glob(f"*{MOTIONS}"))
    }
    if str(path) in bundled:
        return bundled[str(path)]
    listed = ", ".join(bundled)
    raise MissingFileError(
        f"motion file {file} {problem}, and robots with bundled motions are: {listed}"
    )
