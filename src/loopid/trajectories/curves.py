"""Smooth curves that leave a pose at rest and come back to it at rest, linear in what shapes them.

A curve is x(t) = start + Σ_j φ_j(t) x_j with functions φ_j of one variable whose values, rates and
accelerations vanish at both ends, or whose combination does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError

# Rate and acceleration at the ends, as parts of the largest terms, that count as rest.
REST = 1e-9


class Curve(ABC):
    """A detour of c coordinates.

    Attributes
    ----------
    shape : FloatArray
        (m, c), what the functions are multiplied by.
    """

    shape: FloatArray

    @staticmethod
    @abstractmethod
    def functions(count: int, time: FloatArray, seconds: float) -> FloatArray:
        """``count`` functions φ_j, their rates and accelerations (3, N, count) at times (N,)."""

    @abstractmethod
    def backwards(self) -> Curve:
        """The same curve, from its end to its start."""

    def detour(self, time: FloatArray, seconds: float) -> FloatArray:
        """Position off the start, rate and acceleration (3, N, c) at times (N,) of so many s."""
        return self.functions(len(self.shape), time, seconds) @ self.shape

    def _check(self) -> None:
        shape = finite(self.shape, "shape of a curve")
        if shape.ndim != 2 or not shape.size:
            raise DataError(f"the shape of a curve must be (functions, c), not {shape.shape}")
        object.__setattr__(self, "shape", frozen(shape))


@checked_fields
@dataclass(frozen=True, repr=False)
class FourierCurve(Curve):
    """Σ_h sine_h sin(h ω t) + cosine_h (cos(h ω t) - 1) with ω = 2π / T [Swevers1997].

    Attributes
    ----------
    shape : FloatArray
        (2 H, c): sine_1 ... sine_H, then cosine_1 ... cosine_H, with Σ h sine_h = 0 and
        Σ h² cosine_h = 0, so that it starts and ends at rest.
    """

    shape: FloatArray

    def __post_init__(self) -> None:
        self._check()
        if len(self.shape) % 2:
            raise DataError("a Fourier curve has as many sines as cosines")
        terms = self.at_rest(len(self.shape) // 2)
        off = np.abs(terms @ self.shape)
        if (off > REST * (np.abs(terms).sum(axis=0) @ np.abs(self.shape))).any():
            raise DataError(
                "a Fourier curve must start at rest: for each coordinate the sums of h sine_h and "
                "of h² cosine_h must be zero"
            )

    @staticmethod
    def functions(count: int, time: FloatArray, seconds: float) -> FloatArray:
        omega = 2 * np.pi / seconds * np.arange(1, count // 2 + 1)
        sine, cosine = np.sin(np.outer(time, omega)), np.cos(np.outer(time, omega))
        position = np.concatenate([sine, cosine - 1], axis=1)
        rate = np.concatenate([omega * cosine, -omega * sine], axis=1)
        second = np.concatenate([-(omega**2) * sine, -(omega**2) * cosine], axis=1)
        return np.stack([position, rate, second])

    def backwards(self) -> FourierCurve:
        sines = len(self.shape) // 2
        return FourierCurve(np.concatenate([-self.shape[:sines], self.shape[sines:]]))

    @staticmethod
    def at_rest(harmonics: int) -> FloatArray:
        """Rows (2, 2 H) that a shape must be orthogonal to."""
        h, zero = np.arange(1.0, harmonics + 1), np.zeros(harmonics)
        return np.stack([np.append(h, zero), np.append(zero, h**2)])


@checked_fields
@dataclass(frozen=True, repr=False)
class SplineCurve(Curve):
    """A spline of degree five through waypoints at equal times.

    Attributes
    ----------
    shape : FloatArray
        (P, c), waypoints less the start, from which it goes and to which it comes back.
    """

    shape: FloatArray

    def __post_init__(self) -> None:
        self._check()

    def backwards(self) -> SplineCurve:
        return SplineCurve(self.shape[::-1])

    @staticmethod
    def functions(count: int, time: FloatArray, seconds: float) -> FloatArray:
        from scipy.interpolate import make_interp_spline  # slow to import

        knots = np.linspace(0.0, seconds, count + 2)
        rest = [(1, np.zeros(count)), (2, np.zeros(count))]
        through = np.eye(count + 2)[:, 1:-1]
        spline = make_interp_spline(knots, through, k=5, bc_type=(rest, rest))
        at = np.clip(time, 0.0, seconds)
        return np.stack([spline(at, nu) for nu in range(3)])
