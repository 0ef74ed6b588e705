"""A compiled model with the names of its elements, and placements in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

from loopid.loading.mjcf.names import Names


@dataclass(frozen=True)
class Scene:
    """What the parts of the reader work on.

    Attributes
    ----------
    file : Path
    compiled : mujoco.MjModel
    names : Names
    """

    file: Path
    compiled: mujoco.MjModel
    names: Names


def placement(position: Sequence[float], quaternion: Sequence[float] = (1, 0, 0, 0)) -> pin.SE3:
    """Placement by a position and a quaternion in MuJoCo's order: w first."""
    turn = pin.Quaternion(*(float(value) for value in quaternion))
    return pin.SE3(turn.normalized().toRotationMatrix(), np.asarray(position, dtype=np.float64))
