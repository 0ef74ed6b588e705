"""What a log holds once it is read: evenly sampled positions and forces of the motors."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray, IntArray, finite, frozen
from loopid.errors import DataError
from loopid.logs.recording import Dropped
from loopid.scratch import finite_rows, kept, rows_where, sample_rows, steps


@checked_fields
@dataclass(frozen=True)
class Log:
    """Positions and forces of the motors over time, in stretches without gaps.

    Attributes
    ----------
    name : str
    joints : tuple of str
        The actuated joints, in the order of the columns.
    time : FloatArray
        (N,) in s from the log's first sample, increasing, even within each stretch.
    position, force : FloatArray
        (N, dof) in m or rad, and N or N m.
    stretches : IntArray
        (N,), number of the gap-free stretch that a sample belongs to, ascending from 0.
    dropped : tuple of Dropped
        What was left out while reading.
    saturation : FloatArray or None
        (dof,), force from which each drive saturates; None where nothing is known.
    idle_speed : float or None
        Speed in m/s or rad/s at or below which a motor counts as standing.
    """

    name: str
    joints: tuple[str, ...]
    time: FloatArray
    position: FloatArray
    force: FloatArray
    stretches: IntArray
    dropped: tuple[Dropped, ...] = ()
    saturation: FloatArray | None = None
    idle_speed: float | None = None

    def __post_init__(self) -> None:
        time = finite_rows(self.time, "time")
        count = len(time) - 1 if time.ndim == 1 else -1
        if count < 0 or len(rows_where(lambda rows: steps(time, rows) <= 0, count)):
            raise DataError("the time of a log must be a row of increasing numbers")
        numbers: NDArray[Any] = self.stretches
        if not isinstance(numbers, np.ndarray) or numbers.dtype.kind not in "iu":
            numbers = finite(numbers, "stretches")
        if numbers.shape != time.shape or len(
            rows_where(lambda rows: steps(numbers, rows) < 0, count)
        ):
            raise DataError(f"stretches must be {len(time)} ascending numbers, one a sample")
        object.__setattr__(self, "time", kept(time))
        object.__setattr__(self, "stretches", kept(numbers, np.int64))
        for name in ("position", "force"):
            values = sample_rows(getattr(self, name), len(self.joints), name, len(time))
            object.__setattr__(self, name, kept(values))
        if self.saturation is not None:
            object.__setattr__(self, "saturation", frozen(self.saturation))

    def __len__(self) -> int:
        return len(self.time)

    def parts(self) -> list[slice]:
        """The samples of each stretch, in order."""
        changes = 1 + rows_where(lambda rows: steps(self.stretches, rows) > 0, len(self) - 1)
        return [slice(a, b) for a, b in pairwise([0, *changes.tolist(), len(self)])]

    def rate(self, part: slice) -> float:
        """Samples per second of a stretch; 0 for a single sample."""
        time = self.time[part]
        return (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else 0.0
