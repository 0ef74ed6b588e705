"""What a regressor lets be known: zero columns, rank with its gap, null space, regrouping.

[Gautier1991]: with W = U S Vᵀ and rank r, the last columns V2 of V span the combinations of
parameters that no force ever shows. With Pᵀ V2 = [V21; V22], V22 the rows of the dependent
parameters D, W_D = -W_B V21 V22⁻¹, so Φ_base = Φ_B - V21 V22⁻¹ Φ_D reproduces every force:
W_B Φ_base = W Φ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray, finite, frozen
from loopid.errors import DataError, RankError
from loopid.observation import Observation
from loopid.parameters import ParameterSet
from loopid.workers import one_blas_thread

# A column is zero below this fraction of the largest, kg m columns times the characteristic length.
ZERO_COLUMN = 1e-12
# Rows of the null-space basis with a smaller norm belong to parameters outside every combination.
UNTOUCHED = 1e-9
# A rank is believed when its last singular value exceeds the next one this many times ...
MINIMUM_RANK_GAP = 1e3
# ... and the next one is small enough, relative to the largest, to be round-off.
ROUND_OFF_CEILING = 1e-7
# Entries of the null-space projector below this are round-off; entries are at most 1.
CONNECTED = 1e-9
# Regrouping coefficients below this fraction of the largest are round-off of the inversion.
ZERO_COEFFICIENT = 1e-9


@dataclass(frozen=True)
class Structure:
    """Rank and null space of an observation.

    Attributes
    ----------
    parameters : ParameterSet
        The n parameters with an effect.
    columns : IntArray
        (n,), their columns among all the standard parameters.
    singular_values : FloatArray
        (n,), of the columns scaled to unit length, descending.
    rank : int
    rank_gap : float
        Last counted singular value over the next one, which is at least round-off.
    null_basis : FloatArray
        (n, d) with d = n - rank, the paper's V2: orthonormal, W V2 = 0.
    row_factor : FloatArray
        (rank, n), F with FᵀF = WᵀW: W without the directions of round-off.
    """

    parameters: ParameterSet
    columns: IntArray
    singular_values: FloatArray
    rank: int
    rank_gap: float
    null_basis: FloatArray
    row_factor: FloatArray

    def permuted(self, order: IntArray) -> Structure:
        """The same with its parameters in another order (n,)."""
        return replace(
            self,
            parameters=self.parameters.select(order),
            columns=self.columns[order],
            null_basis=self.null_basis[order],
            row_factor=self.row_factor[:, order],
        )


@checked
def analyse(observation: Observation) -> Structure:
    """Find the structure of an observation.

    Raises
    ------
    RankError
        When no parameter has an effect, when a column is neither zero nor clearly not, or when
        no gap in the singular values tells the rank.
    """
    columns = _nonzero_columns(observation)
    R = observation.factor[:, columns]
    # Columns in kg and in kg m² differ by orders of magnitude that mean nothing: scale them.
    norms = np.linalg.norm(R, axis=0)
    with one_blas_thread():
        _, values, right = np.linalg.svd(R / norms)
    rank, gap = decide_rank(values)
    if rank == observation.rows < len(columns):
        raise RankError(
            f"the rank may be larger: it equals the number of rows, {rank}, so more samples are "
            f"needed to tell how many of the {len(columns)} parameters are independent"
        )
    null_basis = _orthonormal(right[rank:].T / norms[:, None])
    return Structure(
        parameters=observation.parameters.select(columns),
        columns=frozen(columns, np.int64),
        singular_values=frozen(values),
        rank=rank,
        rank_gap=gap,
        null_basis=frozen(null_basis),
        row_factor=frozen(values[:rank, None] * right[:rank] * norms),
    )


def _orthonormal(vectors: FloatArray) -> FloatArray:
    """Orthonormal basis of the columns' span, with rows of round-off made zero.

    Left as they are, enough such rows would make a V22 of round-off whose condition number is
    excellent.
    """
    basis, _ = np.linalg.qr(vectors)
    basis[np.linalg.norm(basis, axis=1) < UNTOUCHED] = 0.0
    return basis


def decide_rank(singular_values: FloatArray) -> tuple[int, float]:
    """Rank and gap from descending singular values.

    Raises
    ------
    RankError
        When no gap reaches ``MINIMUM_RANK_GAP``, or two do.
    """
    values = np.asarray(singular_values, dtype=np.float64) / singular_values[0]
    # Round-off leaves about this much of an exact zero: how far below a value is means nothing.
    floor = len(values) * np.finfo(float).eps
    floored = np.append(np.maximum(values, floor), floor)
    gaps = floored[:-1] / floored[1:]
    gaps[floored[1:] > ROUND_OFF_CEILING] = 0.0
    clear = np.flatnonzero(gaps >= MINIMUM_RANK_GAP)
    if len(clear) != 1:
        best = int(gaps.argmax())
        around = ", ".join(f"{value:.1e}" for value in values[max(0, best - 1) : best + 3])
        found = "no gap" if len(clear) == 0 else f"{len(clear)} gaps"
        ranks = "" if len(clear) == 0 else f" (ranks {', '.join(str(k + 1) for k in clear)})"
        raise RankError(
            f"the rank is ambiguous: {found}{ranks} of at least {MINIMUM_RANK_GAP:g} between "
            f"singular values above and below round-off; the largest gap is {gaps[best]:.1f} "
            f"after value {best + 1} of {len(values)} (relative values there: {around})"
        )
    rank = int(clear[0]) + 1
    below = values[rank] if rank < len(values) else 0.0
    return rank, float(values[rank - 1] / max(below, np.finfo(float).eps))


def _nonzero_columns(observation: Observation) -> IntArray:
    scales = observation.length ** observation.parameters.length_powers.astype(np.float64)
    norms = np.linalg.norm(observation.factor, axis=0) * scales
    natural = observation.natural_size * np.sqrt(observation.rows)
    largest = max(float(norms.max(initial=0.0)), natural)
    if (norms <= ZERO_COLUMN * largest).all():
        raise RankError(
            "no parameter has an effect: every column of the regressor is zero, as at rest where "
            "gravity moves no joint"
        )
    relative = norms / largest
    doubtful = (relative > ZERO_COLUMN) & (relative < MINIMUM_RANK_GAP * ZERO_COLUMN)
    if doubtful.any():
        column = int(np.flatnonzero(doubtful)[0])
        raise RankError(
            f"column {observation.parameters[column].label} is neither zero nor clearly not: "
            f"{relative[column]:.1e} of the largest (zero below {ZERO_COLUMN:g}, an effect above "
            f"{MINIMUM_RANK_GAP * ZERO_COLUMN:g})"
        )
    return np.flatnonzero(relative > ZERO_COLUMN)


def independent_blocks(null_basis: FloatArray) -> tuple[IntArray, ...]:
    """Groups of parameters that no null vector connects: components of the projector N = V2 V2ᵀ.

    Regrouping never mixes parameters of different blocks, so a choice is made block by block.

    Parameters
    ----------
    null_basis : FloatArray
        (n, d), orthonormal.

    Returns
    -------
    tuple of IntArray
        Ascending columns of each block, blocks in the order of their first columns. Columns
        that no null vector touches are blocks of their own.
    """
    basis = finite(null_basis, "null_basis")
    if basis.ndim != 2:
        raise DataError(f"null_basis must have shape (n, d), not {basis.shape}")
    connected = np.abs(basis @ basis.T) > CONNECTED
    np.fill_diagonal(connected, True)
    # Each column takes the first column that it is connected with, until all of a block agree.
    first, before = connected.argmax(axis=0), None
    while before is None or (first != before).any():
        first, before = (
            np.where(connected, first, len(first)).min(axis=1, initial=len(first)),
            first,
        )
    return tuple(np.flatnonzero(first == block) for block in np.unique(first))


def base_columns(size: int, dependent: IntArray) -> IntArray:
    """Columns that are not dependent, ascending; shape (n - d,)."""
    is_base = np.ones(size, dtype=bool)
    is_base[dependent] = False
    return np.flatnonzero(is_base)


def regrouping_matrix(null_basis: FloatArray, dependent: IntArray) -> FloatArray:
    """Coefficients β of Φ_base = Φ_B + β Φ_D.

    Parameters
    ----------
    null_basis : FloatArray
        (n, d).
    dependent : IntArray
        (d,), or (c, d) for c choices at once.

    Returns
    -------
    FloatArray
        (n - d, d) or (c, n - d, d); coefficients that are round-off are zero.
    """
    choices = np.atleast_2d(dependent)
    n = len(null_basis)
    base = np.array([base_columns(n, choice) for choice in choices]).reshape(len(choices), -1)
    V21, V22 = null_basis[base], null_basis[choices]
    solution = -np.linalg.solve(V22.transpose(0, 2, 1), V21.transpose(0, 2, 1))
    beta = solution.transpose(0, 2, 1)
    largest = np.abs(beta).max(axis=(1, 2), initial=0.0)
    beta[np.abs(beta) <= ZERO_COEFFICIENT * np.maximum(largest, 1.0)[:, None, None]] = 0.0
    return beta if np.ndim(dependent) == 2 else beta[0]
