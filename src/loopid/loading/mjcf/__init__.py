"""MJCF, the robot files of MuJoCo, read through MuJoCo's own compiler."""

from __future__ import annotations

from pathlib import Path

from loopid.errors import MissingExtraError
from loopid.loading.source import TreeSource


def read_mjcf(path: Path) -> TreeSource:
    """Read tree, closures, motors and reference of an MJCF file.

    Raises
    ------
    MissingExtraError
        When MuJoCo is not installed.
    MissingFileError, RobotFileError
        Naming the file, and MuJoCo's reason or the element that is not supported.
    """
    try:
        import mujoco  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("mujoco", "mjcf") from error
    # Imported here: all of it needs MuJoCo.
    from loopid.loading.mjcf.reading import read_tree

    return read_tree(path)
