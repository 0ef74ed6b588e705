"""A sampled motion of some coordinates, with its first two derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError

# Of a sampled motion: a slip of the pen should not fill the memory.
MOST_SAMPLES = 10_000_000


@checked_fields
@dataclass(frozen=True)
class Motion:
    """Coordinates over time.

    Attributes
    ----------
    names : tuple of str
        The c coordinates: joints, or those of the platform.
    time : FloatArray
        (N,) in s, increasing.
    position, velocity, acceleration : FloatArray
        (N, c) in m or rad, and per s and s²; read-only.
    """

    names: tuple[str, ...]
    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    def __post_init__(self) -> None:
        time = finite(self.time, "time")
        if time.ndim != 1 or len(time) == 0:
            raise DataError(f"time must have shape (samples,), not {time.shape}")
        backwards = np.flatnonzero(np.diff(time) <= 0)
        if len(backwards):
            raise DataError(f"time must increase, but does not after sample {backwards[0]}")
        object.__setattr__(self, "time", frozen(time))
        shape = (len(time), len(self.names))
        for name in ("position", "velocity", "acceleration"):
            values = finite(getattr(self, name), name)
            if values.shape != shape:
                raise DataError(f"{name} must have shape {shape}, not {values.shape}")
            object.__setattr__(self, name, frozen(values))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.time[-1] - self.time[0])


def sample_times(duration: float, rate: float) -> FloatArray:
    """Times from 0 to a duration (s) at a rate (Hz), both ends included.

    Raises
    ------
    DataError
        When either is not positive, or the samples are more than ``MOST_SAMPLES``.
    """
    if not (0 < duration < np.inf and 0 < rate < np.inf):
        raise DataError(f"duration and rate must be positive, not {duration} s and {rate} Hz")
    if not duration * rate < MOST_SAMPLES:
        raise DataError(
            f"{duration:g} s at {rate:g} Hz are {duration * rate:.3g} samples, more than the "
            f"{MOST_SAMPLES:,} that a motion may have"
        )
    steps = int(np.floor(duration * rate * (1 + 1e-12)))
    return np.arange(steps + 1) / rate
