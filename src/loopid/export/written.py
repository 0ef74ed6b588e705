"""Numbers as they are written, and whether a file is read as it was meant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import RobotFileError
from loopid.export.inertias import centre

# Numbers whose change moves no more than this part of the second moments about the link's origin
# stay as they are written.
KEPT = 1e-14
# Relative difference between an inertia as it was meant and as the new file is read.
FAITHFUL = 1e-11


def number(value: float) -> str:
    """The shortest text that is read as the very same number."""
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """Several of them, with spaces between."""
    return " ".join(map(number, values))


def mass_changes(before: float, P: FloatArray) -> bool:
    """Whether an inertia (4, 4) has another mass than is written."""
    return bool(abs(P[3, 3] - before) > KEPT * abs(before))


def centre_changes(before: FloatArray, P: FloatArray) -> bool:
    """Whether it has another centre of mass (3,)."""
    size = np.sqrt(np.trace(P[:3, :3]) / P[3, 3])
    return bool(np.abs(centre(P) - before).max() > KEPT * size)


def tensor_changes(difference: FloatArray, P: FloatArray) -> BoolArray:
    """Which entries of the difference to its inertia tensor (3, 3) are more than round-off."""
    return np.asarray(np.abs(difference) > KEPT * np.trace(P[:3, :3]))


def require_faithful(
    tree: Path, meant: Mapping[str, FloatArray], read: Mapping[str, FloatArray]
) -> None:
    """Refuse new content of a robot file that is not read as it was meant.

    Parameters
    ----------
    meant, read : mapping
        Inertias (4, 4) of all links by name.
    """
    for name, P in meant.items():
        found = read.get(name)
        if found is None or np.abs(found - P).max() > FAITHFUL * np.abs(P).max():
            raise RobotFileError(f"{tree}: the inertial of {name} cannot be changed in place")
