"""Finite Fourier series, the usual periodic excitation [Swevers1997]."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked, checked_fields
from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError
from loopid.trajectories.motion import Motion, sample_times


@checked_fields
@dataclass(frozen=True)
class FourierSeries:
    """x_i(t) = offset_i + Σ_h sine_ih sin(h ω t) + cosine_ih cos(h ω t).

    Attributes
    ----------
    names : tuple of str
        The c coordinates.
    frequency : float
        Of the first harmonic, ω / 2π in Hz.
    offset : FloatArray
        (c,) in m or rad.
    sine, cosine : FloatArray
        (c, harmonics) in m or rad.
    """

    names: tuple[str, ...]
    frequency: float
    offset: FloatArray
    sine: FloatArray
    cosine: FloatArray

    def __post_init__(self) -> None:
        if not 0 < self.frequency < np.inf:
            raise DataError(f"frequency must be positive, not {self.frequency} Hz")
        for name in ("offset", "sine", "cosine"):
            object.__setattr__(self, name, frozen(finite(getattr(self, name), name)))
        expected = (len(self.names), *self.sine.shape[1:2])
        shapes = (self.offset.shape, self.sine.shape, self.cosine.shape)
        if shapes != (expected[:1], expected, expected) or len(expected) != 2:
            raise DataError(
                f"offset, sine and cosine must have shapes (c,), (c, harmonics) and (c, harmonics) "
                f"with c = {len(self.names)}, not {shapes}"
            )

    @property
    def period(self) -> float:
        """Seconds after which the motion repeats."""
        return 1.0 / self.frequency

    @checked
    def motion(self, duration: float | None = None, rate: float = 100.0) -> Motion:
        """Sample the series, by default over one period (duration in s, rate in Hz)."""
        time = sample_times(self.period if duration is None else duration, rate)
        omega = 2 * np.pi * self.frequency * np.arange(1, self.sine.shape[1] + 1)
        sines, cosines = np.sin(np.outer(time, omega)), np.cos(np.outer(time, omega))
        position = self.offset + sines @ self.sine.T + cosines @ self.cosine.T
        velocity = (cosines * omega) @ self.sine.T - (sines * omega) @ self.cosine.T
        acceleration = -(sines * omega**2) @ self.sine.T - (cosines * omega**2) @ self.cosine.T
        return Motion(self.names, time, position, velocity, acceleration)
