"""What another reader makes of a robot's file."""

from __future__ import annotations

import warnings
from pathlib import Path

from loopid.arguments import checked
from loopid.errors import ModelWarning
from loopid.loading.tree_file import find_files
from loopid.loading.urdf import SecondReading, read_again


@checked
def second_opinion(path: str | Path) -> SecondReading | None:
    """Read a robot's URDF once more, with yourdfpy.

    Parameters
    ----------
    path : str or Path
        As for ``load_mechanism``, which it has to have passed.

    Returns
    -------
    SecondReading or None
        None for an MJCF, which MuJoCo's own compiler reads.

    Warns
    -----
    ModelWarning
        For each element that the readers take for something else, with both values.
    """
    files = find_files(path)
    if files.is_mjcf:
        return None
    reading = read_again(files.tree)
    for difference in reading.differences:
        warnings.warn(f"{files.tree}: {difference}", ModelWarning, stacklevel=2)
    return reading
