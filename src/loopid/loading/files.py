"""Which files describe a robot: those of a path, or of the name of a bundled robot."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

from loopid.errors import FileError, RobotFileError
from loopid.files import near_file, require_name, why_no_file
from loopid.loading.description import Description
from loopid.registry import robot_formats
from loopid.robot.robot import Robot

YAML = (".yaml", ".yml")
MOTIONS = "_motions.yaml"


class RobotFiles(NamedTuple):
    """The file that was named, what it says if it is a YAML, and the file of the tree."""

    named: Path
    given: Description
    tree: Path


def bundled_directory() -> Path:
    """Folder of the bundled robots: in the installed package, or in the checkout.

    Returns
    -------
    Path

    Examples
    --------
    >>> from loopid.loading import bundled_directory
    >>> (bundled_directory() / "3ups_rpu.urdf").is_file()
    True
    """
    installed = Path(str(files("loopid"))) / "urdf"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "urdf"


def bundled_robots() -> tuple[str, ...]:
    """Names of the bundled robots, to be given to ``load``.

    Returns
    -------
    tuple of str
        In the order of the alphabet.

    Examples
    --------
    >>> import loopid
    >>> "3ups_rpu" in loopid.bundled_robots()
    True
    """
    directory = bundled_directory()
    urdfs = sorted(file.stem for file in directory.glob("*.urdf"))
    return tuple(name for name in urdfs if (directory / f"{name}.yaml").is_file())


def find_files(path: str | Path) -> RobotFiles:
    """Find a robot's files by the path of one or by a bundled robot's name, and read its YAML."""
    file = _existing(path, ".yaml", bundled_robots(), "", "the bundled robots are")
    given, tree = Description(), file
    if file.suffix in YAML:
        from loopid.yaml_files import read_yaml  # for robots of files alone

        given = read_yaml(file, Description)
        tree = _tree(file, given)
    if tree.suffix not in robot_formats:
        endings = (*YAML, *robot_formats)
        raise RobotFileError(f"{tree}: a robot file ends in {', '.join(endings)}", valid=endings)
    return RobotFiles(file, given, tree)


def _tree(file: Path, given: Description) -> Path:
    """The file of the tree beside a YAML: the one that it names, else that of its own name."""
    named = given.urdf or given.mjcf
    trees = [file.parent / named] if named else [*map(file.with_suffix, robot_formats)]
    problems = [why_no_file(tree) for tree in trees]
    if "" in problems:
        return trees[problems.index("")]
    kind, place = "MJCF" if given.mjcf is not None else "URDF", " ".join(str(trees[0]).split())
    raise FileError(f"{file}: its {kind} {place} is missing: it {problems[0]}")


def files_of(robot: Robot) -> RobotFiles:
    """The files that a robot was loaded from; a FileError where it was made in Python."""
    if robot.path is None:
        raise FileError(
            f"{robot.name} was made in Python, and no file describes it: fit.to_pinocchio() and "
            "fit.to_c(folder) need none"
        )
    return find_files(robot.path)


def own_files(robot: Robot) -> tuple[Path, ...]:
    """The file that a robot was loaded from, and that of its tree, which may be the same.

    None where they are gone since, or never were.
    """
    try:
        files = files_of(robot)
    except FileError:
        return ()
    return files.named, files.tree


def robots_with_motions() -> list[str]:
    """Bundled robots that have motions."""
    found = bundled_directory().glob(f"*{MOTIONS}")
    return sorted(file.name.removesuffix(MOTIONS) for file in found)


def find_motion_file(path: str | Path) -> Path:
    """An existing motion file: the path itself, or the bundled one of a robot's name."""
    bundled = robots_with_motions()
    return _existing(path, MOTIONS, bundled, "motion file ", "robots with bundled motions are")


def _existing(
    path: str | Path, ending: str, bundled: Iterable[str], what: str, listing: str
) -> Path:
    require_name(path, what.strip() or "the robot's file")
    problem = why_no_file(Path(path))
    if not problem:
        return Path(path)
    if str(path) in bundled:
        return bundled_directory() / f"{path}{ending}"
    names = tuple(bundled)
    meant = near_file(Path(path), () if Path(path).suffix else names)
    raise FileError(
        f"{what}{Path(path)} {problem}{meant}, and {listing}: {', '.join(names)}",
        file=str(path),
        valid=names,
    )
