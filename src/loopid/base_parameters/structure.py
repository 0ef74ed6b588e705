"""What a regressor lets be known: rank, null space, independent blocks, regrouping.

[Gautier1991]. Let W = U S Vᵀ have rank r. The last columns V2 of V span the combinations of
parameters that no force ever shows. Let Pᵀ V2 = [V21; V22], V22 the rows of the dependent
parameters D. Then W_D = -W_B V21 V22⁻¹. So Φ_base = Φ_B - V21 V22⁻¹ Φ_D reproduces every force: W_B
Φ_base = W Φ.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg

from loopid.arguments import FloatArray, IntArray, checked, chosen, connected, finite
from loopid.base_parameters.rank import (
    CLEAR,
    DoubtfulCombination,
    RankTolerances,
    decide_rank,
    decomposed,
)
from loopid.errors import DataError
from loopid.numbers import SOLVED_ROUND_OFF
from loopid.observation import Observation
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.workers import one_blas_thread

ZERO = 100.0  # times the round-off of null vectors: shorter rows are zero
NOISE = 10.0  # times the error of a null vector's row: smaller coefficients are none
COARSE = 1e-6  # of the last value that counts, of columns of equal length: more is no round-off


@record(checked="outside")
class Structure:
    """Rank and null space of an observation.

    Attributes
    ----------
    parameters : ParameterSet
        The n parameters with an effect.
    columns : IntArray
        (n,), their columns among all the standard parameters.
    singular_values : FloatArray
        Relative to the largest, of columns in common units, descending.
    rank : int
    rank_gap : float
        Last counted singular value over the next one, or over round-off.
    null_basis : FloatArray
        (n, d) with d = n - rank, the paper's V2: orthonormal, W V2 = 0.
    row_factor : FloatArray
        (rank, n), F with FᵀF = WᵀW: W without the directions that do not count.
    doubtful : tuple of DoubtfulCombination
        Combinations that may have an effect or not; they do not count.
    tolerances : RankTolerances
        What decided.
    rank_bounds : tuple of int or None
        Between which numbers the rank lies where the gap is not clear; None where it is.
    null_errors : FloatArray or None
        (n,), round-off of each row of ``null_basis``, relative to its norm; None for none.
    factor_errors : FloatArray or None
        (n,), what zeros in ``null_basis`` change of each column of ``row_factor``, relative to its
        norm; None for nothing.

    Examples
    --------
    >>> import loopid
    >>> W = loopid.regressors.structural_observation(loopid.load("four_bar"))
    >>> structure = loopid.base_parameters.find_base(W).structure
    >>> structure.rank, structure.null_basis.shape, structure.rank_gap > 1e6
    (4, (7, 3), True)
    """

    parameters: ParameterSet
    columns: IntArray
    singular_values: FloatArray
    rank: int
    rank_gap: float
    null_basis: FloatArray
    row_factor: FloatArray
    doubtful: tuple[DoubtfulCombination, ...] = ()
    tolerances: RankTolerances = RankTolerances()
    rank_bounds: tuple[int, int] | None = None
    null_errors: FloatArray | None = None
    factor_errors: FloatArray | None = None

    @property
    def precision(self) -> float:
        """Of null vectors: round-off, or what doubtful values leave of it."""
        return _precision(self.rank_gap) if self.doubtful else SOLVED_ROUND_OFF

    @property
    def zero(self) -> FloatArray:
        """Parts of its null vectors (n,) below which a parameter's coefficients are none."""
        errors = 0.0 if self.null_errors is None else NOISE * self.null_errors
        return np.asarray(np.maximum(errors, np.full(len(self.null_basis), self.precision)))

    def permuted(self, order: IntArray) -> Structure:
        """The same with its parameters in another order (n,)."""
        order = chosen(order, "order", len(self.parameters))
        return replace(
            self,
            parameters=self.parameters.select(order),
            columns=self.columns[order],
            null_basis=self.null_basis[order],
            null_errors=None if self.null_errors is None else self.null_errors[order],
            factor_errors=None if self.factor_errors is None else self.factor_errors[order],
            row_factor=self.row_factor[:, order],
        )


@checked
def analyse(observation: Observation, tolerances: RankTolerances = RankTolerances()) -> Structure:
    """Find the structure of an observation.

    A RankError says that no parameter has an effect, or that there are too few rows.
    """
    with one_blas_thread():
        decisive = observation.unit_motions or observation
        found = decide_rank(decisive, tolerances)
        if found.bounds and decisive.draws is not None:
            more = decisive.draws.more()
            decisive = more.unit_motions or more
            found = decide_rank(decisive, tolerances)
        columns, rank = found.columns, found.value
        R = decisive.factor[:, columns]
        # Columns of equal length give the most accurate null vectors, unless small ones are noise.
        scales = 1 / np.linalg.norm(R, axis=0)
        values, right = decomposed(R * scales)
        left = np.append(values, 0.0)[rank]
        coarse = bool(found.doubtful) or left > COARSE * values[rank - 1]
        if coarse:
            scales = found.scales[columns]
            values, right = decomposed(R * scales)
        basis = right[rank:].T
        error = max(left, np.finfo(float).eps * values[0]) / values[rank - 1]
        # Rows of round-off are zeros: enough of them would make a V22 with an excellent condition
        # number and no meaning.
        zero = _precision(found.gap) if coarse else ZERO * error
        none = np.linalg.norm(basis, axis=1) < zero
        found_basis = basis.copy()
        basis[none] = 0.0
        basis = np.linalg.qr(basis)[0]
        basis[none] = 0.0  # again: the factorisation leaves its own round-off there
        error = np.finfo(float).eps * values[0] / values[rank - 1] if coarse else error
        sizes = np.linalg.norm(basis, axis=1)
        null_errors = np.divide(error, sizes, out=np.zeros(len(sizes)), where=sizes > 0)
        factor = observation.factor[:, columns] * scales
        lost = (factor @ basis) @ basis.T
        # A row that is not all round-off leaves a part of W when it becomes zero.
        moved = np.linalg.norm(lost - (factor @ found_basis) @ found_basis.T, axis=0)
        factor_errors = moved / np.linalg.norm(factor, axis=0)
        values, right = decomposed(factor - lost)
        factor = values[:rank, None] * right[:rank]
        factor -= (factor @ basis) @ basis.T  # so that both have the same regular choices
    return Structure(
        parameters=observation.parameters.select(columns),
        columns=columns,
        singular_values=found.singular_values,
        rank=rank,
        rank_gap=found.gap,
        null_basis=_orthonormal(basis * scales[:, None]),
        row_factor=factor / scales,
        doubtful=found.doubtful,
        tolerances=tolerances,
        rank_bounds=found.bounds,
        null_errors=null_errors,
        factor_errors=factor_errors,
    )


def _orthonormal(vectors: FloatArray) -> FloatArray:
    """A basis of vectors (n, d), each row as exact as its size allows.

    Rows of very different size lose nothing to the longer ones on three conditions. These come
    first, pivots are chosen [Higham2002, section 19.4], and the factor R is divided by. That is
    done once more for what it left.
    """
    order = np.argsort(-np.linalg.norm(vectors, axis=1), kind="stable")
    for _ in range(2):
        R, pivots = scipy.linalg.qr(vectors[order], mode="r", pivoting=True)
        R = R[: vectors.shape[1]]
        vectors = scipy.linalg.solve_triangular(R, vectors[:, pivots].T, trans="T").T
    return vectors


def _precision(gap: float) -> float:
    """Of null vectors, where doubtful values leave less than round-off does.

    Where the gap is unclear, no part of a null vector is known to be noise: all of it is kept.
    """
    return max(SOLVED_ROUND_OFF, 1 / gap) if gap >= CLEAR else SOLVED_ROUND_OFF


def independent_blocks(null_basis: FloatArray) -> tuple[IntArray, ...]:
    """Groups of parameters that no null vector connects: components of the projector N = V2 V2ᵀ.

    Regrouping never mixes parameters of different blocks. Each is its ascending columns, in the
    order of their first ones, of an orthonormal null basis (n, d). Columns that no null vector
    touches are blocks of their own.
    """
    basis = finite(null_basis, "null_basis")
    if basis.ndim != 2:
        raise DataError(f"null_basis must have shape (n, d), not {basis.shape}", given=basis.shape)
    lengths = np.linalg.norm(basis, axis=1)
    links = np.abs(basis @ basis.T) > SOLVED_ROUND_OFF * np.outer(lengths, lengths)
    return tuple(connected(links))


def base_columns(size: int, dependent: IntArray) -> IntArray:
    """Columns that are not dependent, ascending; shape (n - d,)."""
    is_base = np.ones(size, dtype=bool)
    is_base[dependent] = False
    return np.flatnonzero(is_base)


def regrouping_matrix(
    null_basis: FloatArray, dependent: IntArray, zero: float | FloatArray = SOLVED_ROUND_OFF
) -> FloatArray:
    """Coefficients β = -V21 V22⁻¹ (n - d, d) of Φ_base = Φ_B + β Φ_D.

    Of a null basis (n, d) and dependent columns (d,); or (c, n - d, d) of c choices (c, d).
    Coefficients below the fraction ``zero`` of the lengths of both rows are none; one for all rows,
    or (n,) (``Structure.zero``).
    """
    choices = np.atleast_2d(dependent)
    n = len(null_basis)
    base = np.array([base_columns(n, choice) for choice in choices]).reshape(len(choices), -1)
    V21, V22 = null_basis[base], null_basis[choices]
    solution = -np.linalg.solve(V22.transpose(0, 2, 1), V21.transpose(0, 2, 1))
    beta = solution.transpose(0, 2, 1)
    # Between columns of very different length coefficients are as different.
    lengths = np.linalg.norm(null_basis, axis=1)
    sizes = np.abs(beta) * lengths[choices][:, None, :]
    bounds = (zero * lengths)[base][:, :, None]
    beta[sizes <= bounds] = 0.0
    return beta if np.ndim(dependent) == 2 else beta[0]
