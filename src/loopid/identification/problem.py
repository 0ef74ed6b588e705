"""The data of a fit: samples, and the triangular factors that they are reduced to.

R_i of [W_i | τ_i] = Q_i R_i holds all that least squares needs of the samples of actuator i. This
is so for any weights between actuators, however long the log was. Factors of parts of a log,
stacked and factored again, are those of the whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import (
    BoolArray,
    FloatArray,
    IntArray,
    finite,
    numbers_of,
    row_blocks,
    samples,
    shaped,
)
from loopid.errors import DataError
from loopid.observation import triangular_factor
from loopid.parameters import ParameterSet
from loopid.records import record

DEPENDENT = 1e-6  # part of a unit column beside the others below which it adds nothing


@record(checked="outside")
class FitProblem:
    """Forces and regressors of several actuators, reduced to triangular factors.

    Attributes
    ----------
    parameters : ParameterSet
        The n parameters to be found.
    actuators : tuple of str
    factors : FloatArray
        (dof, n + 1, n + 1), triangular factors of [W_i | τ_i], read-only.
    samples : IntArray
        (dof,), samples of each actuator that take part; may be 0.
    mean_force : FloatArray
        (dof,) in N or N m, over these samples; 0 where there are none.
    least_errors : FloatArray
        (dof,) in N or N m, deviation below which errors count as round-off; 0 for none.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.identification import FitSamples
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> W = np.random.default_rng(0).normal(size=(100, 1, 2))
    >>> samples = FitSamples.of(names, ["motor"], W, W @ [2.0, 0.5])
    >>> problem = samples.problem
    >>> problem.actuators, problem.factors.shape
    (('motor',), (1, 3, 3))
    """

    parameters: ParameterSet
    actuators: tuple[str, ...]
    factors: FloatArray
    samples: IntArray
    mean_force: FloatArray
    least_errors: FloatArray

    @classmethod
    def combined(cls, problems: Iterable[FitProblem]) -> FitProblem:
        """All samples of several problems, such as parts of a log, with one in memory at a time.

        Their order changes the result by round-off only.
        """
        parts = iter(problems)
        whole = next(parts, None)
        if whole is None:
            raise DataError("there are no problems to combine")
        for part in parts:
            if (part.parameters, part.actuators) != (whole.parameters, whole.actuators):
                raise DataError("problems to combine must share their parameters and actuators")
            counts = whole.samples + part.samples
            total = whole.samples * whole.mean_force + part.samples * part.mean_force
            stacked = np.concatenate([whole.factors, part.factors], axis=1)
            whole = replace(
                whole,
                factors=triangular_factor(stacked),
                samples=counts,
                mean_force=total / np.maximum(counts, 1),
                least_errors=np.maximum(whole.least_errors, part.least_errors),
            )
        return whole

    @property
    def rows(self) -> int:
        """Forces that take part, of all actuators."""
        return int(self.samples.sum())

    @property
    def freedom(self) -> int:
        """Rows less parameters."""
        return self.rows - len(self.parameters)

    @cached_property
    def force_rms(self) -> FloatArray:
        """Root mean squares (dof,) of the forces; 0 without samples."""
        return _own(np.sqrt(self.force_squares() / np.maximum(self.samples, 1)))

    @property
    def force_weights(self) -> FloatArray:
        """One over the root mean squares (dof,) of the forces; 0 where there are none."""
        sizes = self.force_rms
        return np.divide(1.0, sizes, out=np.zeros(len(sizes)), where=sizes > 0)

    def weighted(self, weights: FloatArray, prior: FloatArray | None = None) -> FloatArray:
        """One triangular factor (n + 1, n + 1) of all rows times weights (dof,).

        Rows (k, n + 1) of a prior are included as they are.
        """
        own = shaped(weights, "weights", len(self.factors))
        rows = (own[:, None, None] * self.factors).reshape(-1, self.factors.shape[-1])
        rows = rows[rows.any(axis=1)]  # a motor senses few of all parameters
        if prior is not None:
            rows = np.concatenate([rows, samples(prior, rows.shape[1], "prior")])
        return triangular_factor(rows)

    def residual_squares(self, values: FloatArray) -> FloatArray:
        """Sums of squared residuals (dof,) of each actuator at parameter values (n,)."""
        own = shaped(values, "values", len(self.parameters))
        residual = self.factors @ np.append(own, -1.0)
        return np.asarray((residual**2).sum(axis=1), dtype=np.float64)

    def force_squares(self) -> FloatArray:
        """Sums of squared forces (dof,)."""
        return np.asarray((self.factors[:, :, -1] ** 2).sum(axis=1), dtype=np.float64)


@record(checked="outside")
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
    segments : IntArray
        (N,), number of the gap-free, evenly sampled segment of each sample; by default one.
    runs : IntArray
        (N,), number of the recording of each sample; one until samples are ``combined``.
    regions : IntArray
        (N,), number of the region of states of each sample; one unless ``samples_of`` finds them.
    least_errors : FloatArray
        (dof,) in N or N m, deviation below which errors count as round-off, as of forces that are
        known to be zero; by default 0.
    instruments : FloatArray or None
        (N, dof, n), the regressor of a motion whose errors are independent of the measured one's.
    apart : tuple of FloatArray
        Of each motor (N, k), unit columns that are set apart (``apart_from``); by default none.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> W = np.random.default_rng(0).normal(size=(50, 1, 2))
    >>> samples = loopid.identification.FitSamples.of(names, ["motor"], W, W @ [2.0, 0.5])
    >>> len(samples), bool(abs(samples.residual([2.0, 0.5])).max() < 1e-12)
    (50, True)
    """

    parameters: ParameterSet
    actuators: tuple[str, ...]
    regressor: FloatArray
    force: FloatArray
    used: BoolArray
    segments: IntArray
    runs: IntArray
    regions: IntArray
    least_errors: FloatArray
    instruments: FloatArray | None = None
    apart: tuple[FloatArray, ...] = ()

    @classmethod
    def of(
        cls,
        parameters: ParameterSet,
        actuators: Sequence[str],
        regressor: FloatArray,
        force: FloatArray,
        *,
        used: BoolArray | None = None,
        segments: IntArray | None = None,
        least_errors: FloatArray | None = None,
    ) -> FitSamples:
        """Check shapes and values, and fill in the defaults.

        Raises
        ------
        DataError
            When there are no samples, or an array has another shape or type, or is not finite.
        """
        W, dof, n = finite(regressor, "regressor"), len(actuators), len(parameters)
        if W.ndim != 3 or W.shape[1:] != (dof, n):
            raise DataError(f"the regressor must have shape (samples, {dof}, {n}), not {W.shape}")
        if len(W) == 0:
            raise DataError("there are no samples to fit")
        tau, one = shaped(force, "force", len(W), dof), np.zeros(len(W), dtype=np.int64)
        mask = np.ones(tau.shape, dtype=bool) if used is None else used
        parts = one if segments is None else segments
        least = shaped(np.zeros(dof) if least_errors is None else least_errors, "least errors", dof)
        if (least < 0).any():
            raise DataError(f"least errors must be from 0 on, not {least.min()}")
        return cls(
            parameters,
            tuple(actuators),
            W,
            tau,
            _shaped(mask, "used", tau.shape),
            _shaped(parts, "segments", tau.shape[:1]).astype(np.int64, copy=False),
            runs=one,
            regions=one,
            least_errors=least,
        )

    def __len__(self) -> int:
        return len(self.force)

    @cached_property
    def problem(self) -> FitProblem:
        """The same data as triangular factors."""
        return FitProblem.combined(self.block_problem(rows) for rows in row_blocks(len(self)))

    def block_problem(self, rows: slice, factors: FloatArray | None = None) -> FitProblem:
        """Some rows at once as triangular factors, each row (L, dof) times a factor."""
        used, force = self.used[rows], self.force[rows]
        scale = used if factors is None else used * factors
        # Column by column in memory, as LAPACK has it.
        columns = np.empty((force.shape[1], self.regressor.shape[2] + 1, len(force)))
        columns[:, :-1], columns[:, -1] = self.regressor[rows].transpose(1, 2, 0), force.T
        columns *= scale.T[:, None]
        triangles = triangular_factor(columns.swapaxes(1, 2))
        counts = used.sum(axis=0)
        mean = (force * scale).sum(axis=0) / np.maximum(counts, 1)
        numbers = counts, mean, self.least_errors
        return FitProblem(self.parameters, self.actuators, triangles, *numbers)

    @cached_property
    def pieces(self) -> tuple[slice, ...]:
        """Rows of each segment."""
        bounds = 1 + np.flatnonzero(np.diff(self.segments))
        return tuple(slice(*pair) for pair in pairwise([0, *bounds.tolist(), len(self)]))

    def predicted(self, values: FloatArray) -> FloatArray:
        """Forces (N, dof) at parameter values (n,)."""
        return self.regressor @ shaped(values, "values", len(self.parameters))

    def residual(self, values: FloatArray) -> FloatArray:
        """Force less prediction (N, dof) at parameter values (n,), also where not used."""
        return self.force - self.predicted(values)

    def select(self, columns: Iterable[int]) -> FitSamples:
        """The same forces with some of the parameters only."""
        own = numbers_of(columns, "columns", len(self.parameters))
        W, Z = self.regressor, self.instruments
        return replace(
            self,
            parameters=self.parameters.select(own),
            regressor=_own(np.take(W, own, axis=2)),
            instruments=None if Z is None else np.take(Z, own, axis=2),
        )

    def beside(self, parameters: ParameterSet | str, columns: FloatArray) -> FitSamples:
        """The same forces with further parameters, of columns (N, dof, k), after the others.

        A word calls all of them, with numbers.
        """
        if isinstance(parameters, str):
            count = columns.shape[2] if columns.ndim == 3 else 0
            names = (f"{parameters}.{k}" for k in range(count))
            parameters = ParameterSet.from_labels(names)
        columns = self.remaining(shaped(columns, "columns", *self.force.shape, len(parameters)))
        return replace(
            self,
            parameters=self.parameters + parameters,
            regressor=_own(np.concatenate([self.regressor, columns], axis=2)),
        )

    def along(self, directions: FloatArray, parameters: ParameterSet | None = None) -> FitSamples:
        """The same forces with combinations of parameters only, the columns of (n, k).

        Without ``parameters`` (k,) each is named by a parameter with a large part in it, which
        names no other. No more than n have such names.
        """
        count = directions.shape[1] if directions.ndim == 2 else 0
        directions = shaped(directions, "directions", len(self.parameters), count)
        if parameters is None:
            parameters = self._led(directions)
        Z = self.instruments
        return replace(
            self,
            parameters=parameters,
            regressor=self.regressor @ directions,
            instruments=None if Z is None else Z @ directions,
        )

    def _led(self, directions: FloatArray) -> ParameterSet:
        largest = np.abs(directions).max(axis=1, initial=0.0, keepdims=True)
        shares, leads = np.abs(directions) / np.where(largest > 0, largest, 1.0), list[str]()
        for share in shares.T:
            lead = int(np.argmax(share))
            label = self.parameters.labels[lead].removeprefix("sum with ")
            leads.append(f"sum with {label}")
            shares[lead] = -1.0
        return ParameterSet.from_labels(leads)

    def reduced(self, columns: Iterable[int], values: FloatArray) -> FitSamples:
        """Some of the parameters only, with the forces of the others at values (n,) subtracted."""
        own = numbers_of(columns, "columns", len(self.parameters))
        others = np.array(shaped(values, "values", len(self.parameters)))
        others[own] = 0.0
        return self.less(self.predicted(others)).select(own)

    def with_force(self, force: FloatArray) -> FitSamples:
        """The same motion with other forces (N, dof)."""
        return replace(self, force=shaped(force, "force", *self.force.shape))

    def less(self, force: FloatArray) -> FitSamples:
        """The same samples with known forces (N, dof) subtracted."""
        return self.with_force(self.force - shaped(force, "force", *self.force.shape))

    def apart_from(self, columns: FloatArray) -> FitSamples:
        """The same samples without what columns of each motor (N, dof, k) explain, of any size.

        Least squares of what is left are those beside the columns [FrischWaugh1933].
        """
        own = shaped(
            columns, "columns", *self.force.shape, columns.shape[2] if columns.ndim == 3 else 0
        )
        units = (_orthonormal(one) for one in np.moveaxis(own * self.used[:, :, None], 1, 0))
        found = replace(self, apart=tuple(units))
        tau = found.remaining(self.force[:, :, None])[:, :, 0]
        return replace(found, regressor=_own(found.remaining(self.regressor)), force=tau)

    def at(self, rows: IntArray, used: BoolArray) -> FitSamples:
        """Some of the samples, of which (M, dof) take part."""
        of_samples = "regressor", "force", "segments", "runs", "regions"
        found = replace(
            self,
            **{name: getattr(self, name)[rows] for name in of_samples},
            used=self.used[rows] & used,
            instruments=None if self.instruments is None else self.instruments[rows],
            apart=(),
        )
        if not self.apart:
            return found
        columns = np.zeros((*found.force.shape, max(unit.shape[1] for unit in self.apart)))
        for i, unit in enumerate(self.apart):
            columns[:, i, : unit.shape[1]] = unit[rows]
        return found.apart_from(columns)

    def remaining(self, columns: FloatArray) -> FloatArray:
        """Columns (N, dof, k) without what those that are set apart explain of them."""
        left = columns.copy() if self.apart else columns
        for i, unit in enumerate(self.apart):
            left[:, i] -= unit @ (unit.T @ left[:, i])
        return left

    def with_instruments(self, instruments: FloatArray) -> FitSamples:
        """The same samples with instruments (N, dof, n), which go wherever the samples go."""
        Z = shaped(instruments, "instruments", *self.regressor.shape)
        return replace(self, instruments=Z)

    @classmethod
    def combined(cls, parts: Sequence[FitSamples]) -> FitSamples:
        """All samples of several logs, whose segments stay apart."""
        if not parts:
            raise DataError("there are no samples to combine")
        first = parts[0]
        if len(parts) == 1:
            return first
        if any((p.parameters, p.actuators) != (first.parameters, first.actuators) for p in parts):
            raise DataError("samples to combine must share their parameters and actuators")
        instruments = [part.instruments for part in parts if part.instruments is not None]
        if 0 < len(instruments) < len(parts):
            raise DataError("samples to combine must all have instruments, or none of them")

        def numbered(each: Sequence[IntArray]) -> IntArray:
            offsets = np.cumsum([0, *(int(part.max()) + 1 for part in each[:-1])])
            shifted = [part + k for part, k in zip(each, offsets, strict=True)]
            return np.concatenate(shifted)

        runs, regions = numbered([part.runs for part in parts]), [part.regions for part in parts]
        return replace(
            first,
            regressor=np.concatenate([part.regressor for part in parts]),
            force=np.concatenate([part.force for part in parts]),
            used=np.concatenate([part.used for part in parts]),
            segments=numbered([part.segments for part in parts]),
            runs=runs,
            regions=numbered(regions) if any(each.any() for each in regions) else 0 * runs,
            least_errors=np.max([part.least_errors for part in parts], axis=0),
            instruments=np.concatenate(instruments) if instruments else None,
        )


def _orthonormal(columns: FloatArray) -> FloatArray:
    """Unit columns (N, r) that span columns (N, k), each of any size."""
    size = np.linalg.norm(columns, axis=0)
    U, values, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(U[:, values > DEPENDENT])


def _own(array: FloatArray) -> FloatArray:
    """A new array, read-only: records copy those that others may write to."""
    array.setflags(write=False)
    return array


def _shaped(array: NDArray[Any], name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    if array.shape != shape:
        raise DataError(f"{name} must have shape {shape}, not {array.shape}", argument=name)
    return array
