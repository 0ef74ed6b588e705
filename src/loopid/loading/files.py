"""Which files describe a robot: bundled ones by name, and the tree beside a YAML."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from loopid.errors import MissingFileError, RobotFileError
from loopid.files import why_no_file
from loopid.loading.description import Description, read_description

DESCRIPTIONS = (".yaml", ".yml")
MJCF = (".xml", ".mjcf")
SUFFIXES = (*DESCRIPTIONS, ".urdf", *MJCF)
MOTIONS = "_motions.yaml"


@dataclass(frozen=True)
class RobotFiles:
    """The file that was named, what it says if it is a YAML, and the file of the tree."""

    named: Path
    given: Description
    tree: Path

    @property
    def is_mjcf(self) -> bool:
        """Whether the tree is an MJCF; otherwise it is a URDF."""
        return self.tree.suffix in MJCF


def bundled_directory() -> Path:
    """Folder of the bundled robots: in the installed package, or in the checkout."""
    installed = Path(str(files("loopid"))) / "urdf"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "urdf"


def bundled_robots() -> tuple[str, ...]:
    """Names of the bundled robots, to be given to ``load_mechanism``.

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
    """Find a robot's files by the path of one or by a bundled robot's name, and read its YAML.

    Raises
    ------
    MissingFileError, RobotFileError
    """
    file = _existing(path, ".yaml", bundled_robots(), "", "the bundled robots are")
    if file.suffix not in SUFFIXES:
        raise RobotFileError(f"{file}: a robot file ends in {', '.join(SUFFIXES)}")
    if file.suffix not in DESCRIPTIONS:
        return RobotFiles(file, Description(), file)
    given = read_description(file)
    return RobotFiles(file, given, _tree_beside(file, given))


def find_motion_file(path: str | Path) -> Path:
    """An existing motion file: the path itself, or the bundled one of a robot's name."""
    bundled = [file.name.removesuffix(MOTIONS) for file in bundled_directory().glob(f"*{MOTIONS}")]
    return _existing(
        path, MOTIONS, sorted(bundled), "motion file ", "robots with bundled motions are"
    )


def _existing(
    path: str | Path, ending: str, bundled: Iterable[str], what: str, listing: str
) -> Path:
    problem = why_no_file(Path(path))
    if not problem:
        return Path(path)
    if str(path) in bundled:
        return bundled_directory() / f"{path}{ending}"
    raise MissingFileError(f"{what}{Path(path)} {problem}, and {listing}: {', '.join(bundled)}")


def _tree_beside(file: Path, description: Description) -> Path:
    named = description.urdf or description.mjcf
    suffixes = (".urdf", *MJCF)
    candidates = [file.parent / named] if named else [file.with_suffix(s) for s in suffixes]
    for tree in candidates:
        if not why_no_file(tree):
            return tree
    kind = "MJCF" if description.mjcf is not None else "URDF"
    missing = " ".join(str(candidates[0]).split())
    reason = why_no_file(candidates[0])
    raise MissingFileError(f"{file}: its {kind} {missing} is missing: it {reason}")
