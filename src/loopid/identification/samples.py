"""The samples of a fit: what a problem is reduced from, and what residuals are computed on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray, finite, frozen
from loopid.errors import DataError
from loopid.parameters import ParameterSet


@dataclass(frozen=True)
class FitSamples:
    """Forces of several actuators over time, and their regressor.

    Attributes
    ----------
    parameters : ParameterSet
        Names of the n columns.
    actuators : tuple of str
    regressor : FloatArray
        (N, dof, n) in N or N m per unit parameter.
    force : FloatArray
        (N, dof) in N or N m.
    used : BoolArray
        (N, dof), which forces take part; by default all.
    stretches : IntArray
        (N,), number of the gap-free, evenly sampled stretch of each sample; by default one.
    """

    parameters: ParameterSet
    actuators: tuple[str, ...]
    regressor: FloatArray
    force: FloatArray
    used: BoolArray
    stretches: IntArray

    @classmethod
    def of(
        cls,
        parameters: ParameterSet,
        actuators: Sequence[str],
        regressor: FloatArray,
        force: FloatArray,
        used: BoolArray | None = None,
        stretches: IntArray | None = None,
    ) -> FitSamples:
        """Check shapes and values, and fill in the defaults."""
        W, tau = finite(regressor, "regressor"), finite(force, "force")
        expected = (len(actuators), len(parameters))
        if W.ndim != 3 or W.shape[1:] != expected:
            raise DataError(f"the regressor must have shape (samples, *{expected}), not {W.shape}")
        if tau.shape != W.shape[:2]:
            raise DataError(f"force must have shape {W.shape[:2]}, not {tau.shape}")
        if len(W) == 0:
            raise DataError("there are no samples to fit")
        kept = np.ones(tau.shape, dtype=bool) if used is None else np.asarray(used)
        parts = np.zeros(len(tau), dtype=np.int64) if stretches is None else np.asarray(stretches)
        if kept.shape != tau.shape or kept.dtype != bool:
            raise DataError(f"used must be booleans of shape {tau.shape}, not {kept.shape}")
        if parts.shape != tau.shape[:1]:
            raise DataError(f"stretches must have shape {tau.shape[:1]}, not {parts.shape}")
        return cls(
            parameters,
            tuple(actuators),
            frozen(W),
            frozen(tau),
            frozen(kept, np.bool_),
            frozen(parts, np.int64),
        )

    def __len__(self) -> int:
        return len(self.force)

    def residual(self, values: FloatArray) -> FloatArray:
        """Force less prediction (N, dof) at parameter values (n,), also where not used."""
        return np.asarray(self.force - self.regressor @ values, dtype=np.float64)

    def select(self, columns: Iterable[int]) -> FitSamples:
        """The same forces with some of the parameters only."""
        chosen = [int(j) for j in columns]
        W = self.regressor[:, :, chosen]
        names = self.parameters.select(chosen)
        return FitSamples.of(names, self.actuators, W, self.force, self.used, self.stretches)

    def less(self, force: FloatArray) -> FitSamples:
        """The same samples after known forces (N, dof) have been taken away."""
        left = self.force - force
        W, names = self.regressor, self.parameters
        return FitSamples.of(names, self.actuators, W, left, self.used, self.stretches)

    @classmethod
    def combined(cls, parts: Sequence[FitSamples]) -> FitSamples:
        """All samples of several logs, whose stretches stay apart."""
        if not parts:
            raise DataError("there are no samples to combine")
        first = parts[0]
        for part in parts:
            if (part.parameters, part.actuators) != (first.parameters, first.actuators):
                raise DataError("samples to combine must share their parameters and actuators")
        offsets = np.cumsum([0, *(int(part.stretches.max()) + 1 for part in parts[:-1])])
        return cls.of(
            first.parameters,
            first.actuators,
            np.concatenate([part.regressor for part in parts]),
            np.concatenate([part.force for part in parts]),
            np.concatenate([part.used for part in parts]),
            np.concatenate([part.stretches + k for part, k in zip(parts, offsets, strict=True)]),
        )
