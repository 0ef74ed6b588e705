"""Which files describe a robot: a YAML of its own, and the URDF or MJCF of its tree."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from loopid.errors import MissingFileError
from loopid.files import why_no_file
from loopid.loading.bundled import find_robot_file
from loopid.loading.description import Description, read_description

DESCRIPTIONS = (".yaml", ".yml")
MJCF = (".xml", ".mjcf")


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


def find_files(path: str | Path) -> RobotFiles:
    """Find a robot's files, and read its YAML.

    Raises
    ------
    MissingFileError, RobotFileError
    """
    file = find_robot_file(path)
    if file.suffix not in DESCRIPTIONS:
        return RobotFiles(file, Description(), file)
    given = read_description(file)
    return RobotFiles(file, given, _tree_beside(file, given))


def _tree_beside(file: Path, description: Description) -> Path:
    named = description.urdf or description.mjcf
    if named is not None:
        candidates = [file.parent / named]
    else:
        candidates = [file.with_suffix(suffix) for suffix in (".urdf", *MJCF)]
    for tree in candidates:
        if not why_no_file(tree):
            return tree
    kind = "MJCF" if description.mjcf is not None else "URDF"
    missing = " ".join(str(candidates[0]).split())
    reason = why_no_file(candidates[0])
    raise MissingFileError(f"{file}: its {kind} {missing} is missing: it {reason}")
