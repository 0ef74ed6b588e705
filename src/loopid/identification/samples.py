"""The samples of a fit: what a problem is reduced from, and what residuals are computed on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import checked
from loopid.arrays import BoolArray, FloatArray, IntArray, frozen
from loopid.errors import DataError
from loopid.identification.checks import (
    checked_force,
    checked_least_errors,
    checked_mask,
    checked_samples,
    checked_stretches,
)
from loopid.identification.problem import FitProblem
from loopid.parameters import ParameterSet
from loopid.scratch import finite_rows, kept, mapped_rows, row_blocks, rows_where, spooled


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
    instruments : FloatArray or None
        (N, dof, n), the regressor of a motion that knows nothing of the errors of the measured one.
    """

    parameters: ParameterSet
    actuators: tuple[str, ...]
    regressor: FloatArray
    force: FloatArray
    used: BoolArray
    stretches: IntArray
    least_errors: FloatArray
    instruments: FloatArray | None = None

    @classmethod
    @checked
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
        mask = checked_mask(used, tau)
        parts = checked_stretches(stretches, len(tau))
        least = checked_least_errors(least_errors, tau.shape[1])
        return cls(
            parameters,
            tuple(actuators),
            kept(W),
            kept(tau),
            kept(mask, np.bool_),
            kept(parts, np.int64),
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
        bounds = [0, *(int(k) for k in _changes(self.stretches)), len(self)]
        return tuple(slice(*pair) for pair in pairwise(bounds))

    def predicted(self, values: FloatArray) -> FloatArray:
        """Forces (N, dof) at parameter values (n,)."""
        return mapped_rows(lambda rows: self.regressor[rows] @ values, len(self))

    def residual(self, values: FloatArray) -> FloatArray:
        """Force less prediction (N, dof) at parameter values (n,), also where not used."""
        return mapped_rows(lambda rows: self.force[rows] - self.regressor[rows] @ values, len(self))

    def select(self, columns: Iterable[int]) -> FitSamples:
        """The same forces with some of the parameters only."""
        chosen = [int(j) for j in columns]
        W = _columns(self.regressor, chosen)
        Z = None if self.instruments is None else _columns(self.instruments, chosen)
        names = self.parameters.select(chosen)
        return replace(self, parameters=names, regressor=W, instruments=Z)

    def with_force(self, force: FloatArray) -> FitSamples:
        """The same motion with other forces (N, dof)."""
        return replace(self, force=kept(checked_force(force, self.regressor)))

    def with_instruments(self, instruments: FloatArray) -> FitSamples:
        """The same samples with instruments (N, dof, n), which go wherever the samples go.

        Raises
        ------
        DataError
            When they are not of the regressor's shape, or not finite.
        """
        Z = finite_rows(instruments, "instruments")
        if Z.shape != self.regressor.shape:
            raise DataError(
                f"instruments must have the regressor's shape {self.regressor.shape}, not {Z.shape}"
            )
        return replace(self, instruments=kept(Z))

    def less(self, force: FloatArray) -> FitSamples:
        """The same samples after known forces (N, dof) have been taken away."""
        left = mapped_rows(lambda rows: self.force[rows] - force[rows], len(self))
        return self.with_force(left)

    @classmethod
    def combined(cls, parts: Sequence[FitSamples]) -> FitSamples:
        """All samples of several logs, whose stretches stay apart."""
        if not parts:
            raise DataError("there are no samples to combine")
        first = parts[0]
        for part in parts:
            if (part.parameters, part.actuators) != (first.parameters, first.actuators):
                raise DataError("samples to combine must share their parameters and actuators")
        if len(parts) == 1:
            return first
        return cls(
            first.parameters,
            first.actuators,
            _concatenated([part.regressor for part in parts]),
            _concatenated([part.force for part in parts]),
            _concatenated([part.used for part in parts]),
            _concatenated_stretches([part.stretches for part in parts]),
            np.max([part.least_errors for part in parts], axis=0),
            _concatenated_instruments([part.instruments for part in parts]),
        )


def _columns(array: FloatArray, chosen: list[int]) -> FloatArray:
    return mapped_rows(lambda rows: array[rows][:, :, chosen], len(array))


def _changes(numbers: IntArray) -> IntArray:
    """Rows whose number differs from that of the row before."""
    return 1 + rows_where(
        lambda rows: numbers[rows] != numbers[rows.start + 1 : rows.stop + 1], len(numbers) - 1
    )


def _concatenated(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return spooled(array[rows] for array in arrays for rows in row_blocks(len(array)))


def _concatenated_instruments(parts: Sequence[FloatArray | None]) -> FloatArray | None:
    given = [part for part in parts if part is not None]
    if given and len(given) < len(parts):
        raise DataError("samples to combine must all have instruments, or none of them")
    return _concatenated(given) if given else None


def _concatenated_stretches(parts: Sequence[IntArray]) -> IntArray:
    largest = [max(int(part[rows].max()) for rows in row_blocks(len(part))) for part in parts]
    offsets = np.cumsum([0, *(number + 1 for number in largest[:-1])])
    return spooled(
        part[rows] + offset
        for part, offset in zip(parts, offsets, strict=True)
        for rows in row_blocks(len(part))
    )
