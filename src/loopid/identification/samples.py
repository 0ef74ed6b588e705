"""The samples of a fit: what a problem is reduced from, and what residuals are computed on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray, finite, frozen
from loopid.errors import DataError
from loopid.identification.problem import FitProblem, checked_mask, checked_samples
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
    least_errors : FloatArray
        (dof,) in N or N m, deviation below which errors count as round-off, as of forces that are
        known to be zero; by default 0.
    """

    parameters: ParameterSet
    actuators: tuple[str, ...]
    regressor: FloatArray
    force: FloatArray
    used: BoolArray
    stretches: IntArray
    least_errors: FloatArray

    @classmethod
    def of(
        cls,
        parameters: ParameterSet,
        actuators: Sequence[str],
        regressor: FloatArray,
        force: FloatArray,
        used: BoolArray | None = None,
        stretches: IntArray | None = None,
        least_errors: FloatArray | None = None,
    ) -> FitSamples:
        """Check shapes and values, and fill in the defaults."""
        W, tau = checked_samples(regressor, force, parameters, actuators)
        kept = checked_mask(used, tau)
        parts = np.zeros(len(tau), dtype=np.int64) if stretches is None else np.asarray(stretches)
        if parts.shape != tau.shape[:1]:
            raise DataError(f"stretches must have shape {tau.shape[:1]}, not {parts.shape}")
        least = (
            np.zeros(tau.shape[1]) if least_errors is None else finite(least_errors, "least errors")
        )
        if least.shape != tau.shape[1:] or (least < 0).any():
            raise DataError(f"least errors must be {tau.shape[1]} numbers from 0 on")
        return cls(
            parameters,
            tuple(actuators),
            frozen(W),
            frozen(tau),
            frozen(kept, np.bool_),
            frozen(parts, np.int64),
            frozen(least),
        )

    def __len__(self) -> int:
        return len(self.force)

    @cached_property
    def problem(self) -> FitProblem:
        """The same data as triangular factors."""
        data = self.regressor, self.force, self.parameters, self.actuators
        return FitProblem.from_samples(*data, self.used, self.least_errors)

    @cached_property
    def pieces(self) -> tuple[slice, ...]:
        """Rows of each stretch."""
        starts = np.flatnonzero(np.diff(self.stretches)) + 1
        bounds = [0, *(int(k) for k in starts), len(self)]
        return tuple(slice(*pair) for pair in pairwise(bounds))

    def residual(self, values: FloatArray) -> FloatArray:
        """Force less prediction (N, dof) at parameter values (n,), also where not used."""
        return np.asarray(self.force - self.regressor @ values, dtype=np.float64)

    def select(self, columns: Iterable[int]) -> FitSamples:
        """The same forces with some of the parameters only."""
        chosen = [int(j) for j in columns]
        W = self.regressor[:, :, chosen]
        names = self.parameters.select(chosen)
        return FitSamples.of(names, self.actuators, W, self.force, *self._other)

    def with_force(self, force: FloatArray) -> FitSamples:
        """The same motion with other forces (N, dof)."""
        W, names = self.regressor, self.parameters
        return FitSamples.of(names, self.actuators, W, force, *self._other)

    @property
    def _other(self) -> tuple[BoolArray, IntArray, FloatArray]:
        return self.used, self.stretches, self.least_errors

    def less(self, force: FloatArray) -> FitSamples:
        """The same samples after known forces (N, dof) have been taken away."""
        return self.with_force(self.force - force)

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
            np.max([part.least_errors for part in parts], axis=0),
        )
