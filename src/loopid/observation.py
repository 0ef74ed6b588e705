"""The observation: a stacked regressor, reduced to its triangular factor.

Rank, null space, conditioning and least squares need only R of W = Q R. Its size does not depend on
the number of samples. LAPACK's Householder method for triangles on top of rows finds it, on as many
rows at a time as stay in the processor's cache [Demmel2012]. This is twice as fast as a QR
factorisation of blocks. Columns of zeros cost nothing.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from scipy.linalg.lapack import dtpqrt

from loopid.arguments import (
    BoolArray,
    FloatArray,
    NotNegative,
    Positive,
    finite,
    frozen,
    row_blocks,
)
from loopid.errors import DataError
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.workers import one_blas_thread

# Rows that are reduced at a time, and columns whose reflections are applied together: this many, or
# a part of all.
ROWS = 400
PANEL, PANEL_PART = 8, 16


class Draws(ABC):
    """How the rows of an observation were drawn, so that others like them can be."""

    # Of lengths in the robot file, in m; of angles, times the characteristic length; 0 where exact
    accuracy: float
    source: str  # where it is known from

    @abstractmethod
    def rounded(self, count: int, within: float | None = None) -> FloatArray:
        """Triangular factors (1 + count, n, n) of the geometry as written, and of others like it.

        At the same poses. The others round to the same file, or are ``within`` another accuracy
        than the file's, in m.
        """

    @abstractmethod
    def more(self) -> Observation:
        """The observation with more samples: these, and others of another seed."""


@record(checked="outside")
class Observation:
    """Stacked rows of a regressor W, reduced to R of W = Q R.

    Attributes
    ----------
    parameters : ParameterSet
        Names of the n columns.
    factor : FloatArray
        (n, n) upper triangular R with RᵀR = WᵀW, read-only.
    rows : int
        Rows of W.
    length : float
        Characteristic length in m: a column per kg m counts this much more than one per kg.
    natural_size : float
        What an entry of a column per kg amounts to in a robot of this length, in N or N m:
        columns that are smaller by the order of round-off are zero, even if all of them are.
    order : tuple of str
        Links and joints in the order in which the first of equally good choices is taken, where
        it is not that of the columns.
    draws : Draws or None
        None where the robot is not known.
    unit_motions : Observation or None
        Rows of the same samples that decide rank and null space in place of W's: forces along
        motions of one size, in common units, which grow near no singularity of the motors. None
        where W decides.
    motors_alone : Observation or None
        Without the rows "= 0" of coordinates that the motors leave free, where there are any.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> observed = loopid.observation.Observation.from_matrix(np.eye(5, 2), names)
    >>> observed.rows, observed.factor.shape
    (5, (2, 2))
    """

    parameters: ParameterSet
    factor: FloatArray
    rows: int
    length: Positive = 1.0
    natural_size: NotNegative = 0.0
    order: tuple[str, ...] = ()
    draws: Draws | None = None
    unit_motions: Observation | None = None
    motors_alone: Observation | None = None

    @classmethod
    def from_matrix(
        cls,
        matrix: FloatArray,
        parameters: ParameterSet,
        *,
        length: float = 1.0,
        natural_size: float = 0.0,
    ) -> Observation:
        """Factor an observation matrix (rows, n), or (N, dof, n) to be stacked."""
        rows = StackedRows(parameters)
        rows.add(matrix)
        return rows.observation(length=length, natural_size=natural_size)


class StackedRows:
    """Rows of an observation that come in parts; the first ``driven`` of a sample are motors'.

    A joint's row has columns only of the bodies that move with it: in a tree, few of all. So each
    of the dof rows of a sample is reduced on its own, as long as there are more samples than
    columns. At the end all of them are reduced together.
    """

    def __init__(self, parameters: ParameterSet, driven: int | None = None) -> None:
        self.parameters, self.driven = parameters, driven
        self._rows, self._driven_rows = 0, 0
        self._factors, self._waiting = np.zeros((0, *2 * (len(parameters),))), list[FloatArray]()

    def add(self, part: FloatArray) -> None:
        """Reduce a matrix (rows, n), or samples (N, dof, n)."""
        W = _samples(part, len(self.parameters))
        for block in row_blocks(len(W)):
            self._waiting.append(W[block])
            if sum(map(len, self._waiting)) >= len(self.parameters):
                self._factors, self._waiting = _reduced(self._factors, self._waiting), []
        self._rows += len(W) * W.shape[1]
        self._driven_rows += len(W) * (self.driven or 0)

    def observation(self, *, length: float = 1.0, natural_size: float = 0.0) -> Observation:
        """What all the rows so far make."""
        if self._rows == 0:
            raise DataError("the observation matrix has no rows")
        units: dict[str, Any] = {"length": length, "natural_size": natural_size}
        factor, driven, alone = _stacked([self._factors, *self._waiting]), self.driven, None
        if driven is not None:
            own = _stacked([self._factors[:driven], *(W[:, :driven] for W in self._waiting)])
            alone = Observation(self.parameters, own, self._driven_rows, **units)
        return Observation(self.parameters, factor, self._rows, **units, motors_alone=alone)


def _reduced(factors: FloatArray, samples: list[FloatArray]) -> FloatArray:
    """Factors (dof, n, n) of those before and of samples (N, dof, n), row by row of a sample."""
    for W in samples:
        more = W.shape[1] - len(factors)
        if more > 0:
            factors = np.concatenate([factors, np.zeros((more, *factors.shape[1:]))])
        add_rows(factors[: W.shape[1]], W.swapaxes(0, 1))
    return factors


def _stacked(matrices: list[FloatArray]) -> FloatArray:
    """The triangular factor (n, n), read-only, of the rows of matrices (..., n)."""
    rows = np.concatenate([matrix.reshape(-1, matrix.shape[-1]) for matrix in matrices])
    return frozen(triangular_factor(rows[rows.any(axis=1)]))


def _samples(matrix: FloatArray, width: int) -> FloatArray:
    """Samples (N, dof, n); those of a matrix that is stacked already have one row each."""
    W = finite(matrix, "observation matrix")
    if W.ndim not in (2, 3) or W.shape[-1] != width:
        raise DataError(
            f"the observation matrix must have {width} columns, not shape {W.shape}", given=W.shape
        )
    return W if W.ndim == 3 else W[:, None]


def triangular_factor(matrix: FloatArray) -> FloatArray:
    """Square upper triangular R of matrices (..., m, n), padded with zero rows where m < n."""
    factors = np.zeros((*matrix.shape[:-2], matrix.shape[-1], matrix.shape[-1]))
    add_rows(factors, matrix)
    return factors


def add_rows(factors: FloatArray, matrix: FloatArray) -> None:
    """Make factors (..., n, n) in place those of the rows so far and of matrices (..., m, n)."""
    with one_blas_thread():
        for k in np.ndindex(*matrix.shape[:-2]):
            kept = np.flatnonzero(_touched(matrix[k]) | factors[k].any(axis=0))
            if len(kept) and len(matrix[k]):
                square = np.ix_(kept, kept)
                factors[k][square] = updated_factor(factors[k][square], matrix[k].T[kept].T)


def _touched(matrix: FloatArray) -> BoolArray:
    """Which columns (n,) of a matrix (m, n) are not zero; most show it in the first rows."""
    touched = np.asarray(matrix[: matrix.shape[1]].any(axis=0), dtype=bool)
    touched[~touched] = matrix[:, ~touched].any(axis=0)
    return touched


def updated_factor(factor: FloatArray, matrix: FloatArray) -> FloatArray:
    """A factor (n, n) updated with the rows of a matrix (m, n)."""
    width, factor = len(factor), np.asfortranarray(factor)
    step, panel = max(ROWS, width), min(max(PANEL, width // PANEL_PART), width)
    for start in range(0, len(matrix), step):
        part = np.asfortranarray(matrix[start : start + step])
        factor, _, _, failed = dtpqrt(0, panel, factor, part, overwrite_a=True, overwrite_b=True)
        if failed:
            raise DataError(f"the triangular factor failed with LAPACK's code {failed}")
    return np.asarray(np.triu(factor), dtype=np.float64)
