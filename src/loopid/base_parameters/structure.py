"""What a regressor lets be known: zero columns, rank with its gap, null space, regrouping.

[Gautier1991]: with W = U S Vᵀ and rank r, the last columns V2 of V span the combinations of
parameters that no force ever shows. With Pᵀ V2 = [V21; V22], V22 the rows of the dependent
parameters D, W_D = -W_B V21 V22⁻¹, so Φ_base = Φ_B - V21 V22⁻¹ Φ_D reproduces every force:
W_B Φ_base = W Φ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from loopid.arguments import (
    FloatArray,
    IntArray,
    checked,
    finite,
    frozen,
)
from loopid.errors import (
    AccuracyWarning,
    DataError,
    RankError,
    warn,
)
from loopid.observation import Observation
from loopid.parameters import (
    KINDS,
    ParameterSet,
)
from loopid.workers import one_blas_thread

# A column is zero below this fraction of the largest, kg m columns times the characteristic length.
ZERO_COLUMN = 1e-12
# Rows of the null-space basis with a smaller norm belong to parameters outside every combination.
UNTOUCHED = 1e-9
# A rank is believed when its last singular value exceeds the next one this many times ...
MINIMUM_RANK_GAP = 1e3
# ... and the next one is small enough, relative to the largest, to be round-off.
ROUND_OFF_CEILING = 1e-7
# Singular values, of columns in common units, are looked at for the noise of rounded geometry where
# the least one is within reach of the accuracy.
REACH, FARTHEST = 1e3, 1e-3
# Values below these are zeros: per column, and relative to the accuracy (products of two roundings,
# which come with larger ones).
ROUND_OFF, SECOND_ORDER = 1e-15, 1e-5
# Other geometries that are tried, and the part of a singular value that changes with them (root
# mean square) if it is not evidence of rank: few to see whether there may be noise, then more.
DRAWS = ((2, 0.005), (8, 0.05))
CLEAR_OF_NOISE = 100.0  # how many times what counts exceeds the noise
SIX_DIGITS = 1e-6  # m, rounding that is asked for where a column or a value is nearly zero
COARSER = 10.0  # rounding that is asked for where the one that is known does not explain a value
NEAR_INVERSE = (
    10.0  # condition numbers within this factor of the inverse of the accuracy are warned of
)
# Forces hardly depend on combinations with a smaller relative singular value: the least of robots
# whose numbers are exact is some 5e-6 (a floating biped).
FAINT = 1e-7
NAMED, DIGITS = 4, 6  # values, parameters and lengths in a message; digits that weights have
# Relative singular values of the combinations that an ambiguous rank is about.
LEAST_UNCLEAR, MOST_UNCLEAR = 1e-14, 1e-4
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
        Last counted singular value over the next one, which is at least round-off, or the noise.
    null_basis : FloatArray
        (n, d) with d = n - rank, the paper's V2: orthonormal, W V2 = 0.
    row_factor : FloatArray
        (rank, n), F with FᵀF = WᵀW: W without the directions of round-off.
    noise : float
        Largest singular value, relative, that rounded numbers of the robot file make; 0 where none
        is in doubt. Where there is noise, singular values are those of columns in common units, and
        the gap is above the noise.
    noise_source : str
        Where the accuracy of the geometry is known from.
    """

    parameters: ParameterSet
    columns: IntArray
    singular_values: FloatArray
    rank: int
    rank_gap: float
    null_basis: FloatArray
    row_factor: FloatArray
    noise: float = 0.0
    noise_source: str = ""

    @property
    def precision(self) -> float:
        """Of null vectors: round-off, or what rounded geometry leaves of it."""
        return max(UNTOUCHED, 1 / self.rank_gap) if self.noise else UNTOUCHED

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
        When no parameter has an effect, or when no gap in the singular values tells the rank.

    Warns
    -----
    AccuracyWarning
        When singular values that are not round-off do not count, as the geometry is rounded.
    """
    with one_blas_thread():
        noise = _geometry_noise(observation)
        columns, doubtful = _nonzero_columns(observation, noise)
        R = observation.factor[:, columns]
        # Columns in kg and in kg m² differ by orders of magnitude that mean nothing: scale them,
        # but not round-off to the size of the rest.
        common, norms = _scales(observation)[columns], np.linalg.norm(R, axis=0)
        scales = common if noise is not None or doubtful else 1 / norms
        values, right = _decomposed(R * scales)
        # All columns have the round-off of the largest: scaling lifts that of small ones.
        lifted = np.linalg.norm(right[: len(values)] * scales / common, axis=1)
        round_off = len(values) * np.finfo(float).eps * (norms * common).max() * lifted
    try:
        rank, gap = decide_rank(values, round_off) if noise is None else (noise.rank, noise.gap)
        between = (values > LEAST_UNCLEAR * values[0]) & (values < FAINT * values[0])
        if doubtful and between.any():
            raise RankError(doubtful)
    except RankError as error:
        if doubtful:
            raise RankError(doubtful) from None
        unclear = right[(values > LEAST_UNCLEAR * values[0]) & (values < MOST_UNCLEAR * values[0])]
        relative = values / values[0]
        faint = relative[(relative < ROUND_OFF_CEILING) & (relative > LEAST_UNCLEAR)]
        made = float(faint.max(initial=0.0)) * observation.length
        concerned = _concerned(observation, columns, unclear, made)
        raise RankError(f"{error}; {concerned}") from None
    if rank == observation.rows < len(columns):
        raise RankError(
            f"the rank may be larger: it equals the number of rows, {rank}, so more samples are "
            f"needed to tell how many of the {len(columns)} parameters are independent"
        )
    precision = UNTOUCHED if noise is None else max(UNTOUCHED, 1 / gap)
    return Structure(
        parameters=observation.parameters.select(columns),
        columns=frozen(columns, np.int64),
        singular_values=frozen(values),
        rank=rank,
        rank_gap=gap,
        null_basis=frozen(_orthonormal(right[rank:].T * scales[:, None], precision)),
        row_factor=frozen(values[:rank, None] * right[:rank] / scales),
        noise=0.0 if noise is None else noise.level,
        noise_source="" if noise is None else noise.source,
    )


def _decomposed(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Singular values and all right singular vectors, as rows.

    LAPACK's divide and conquer, the fast way, does not converge for some matrices without full
    rank; QR iterations then do.
    """
    try:
        _, values, right = np.linalg.svd(matrix)
    except np.linalg.LinAlgError:
        _, values, right = scipy.linalg.svd(matrix, lapack_driver="gesvd")
    return values, right


def warn_of_faint(observation: Observation, structure: Structure) -> None:
    """Name combinations that count although forces hardly depend on them."""
    if structure.noise:
        return
    F = structure.row_factor * _scales(observation)[structure.columns]
    # Terms of joints have units, hence sizes, of their own.
    sizes, of_joint = np.linalg.norm(F, axis=0), [p.kind not in KINDS for p in structure.parameters]
    F *= np.where(of_joint, sizes.max() / sizes, 1.0)
    values = np.linalg.svd(F, compute_uv=False)
    rank, most = structure.rank, int((values >= FAINT * values[0]).sum())
    if most == rank:
        return
    least, (_, right) = values[-1] / values[0], _decomposed(F)
    warn(
        f"{rank - most} of the {rank} singular values that count, of columns in common units, are "
        f"below {FAINT:g} of the largest, down to {least:.1e}: rounded or nearly special "
        f"geometry makes such values, and then the rank is at most {most}; "
        f"{_concerned(observation, structure.columns, right[most:rank], SIX_DIGITS)}",
        AccuracyWarning,
    )


def _orthonormal(vectors: FloatArray, precision: float) -> FloatArray:
    """Orthonormal basis of the columns' span, with rows of round-off or noise made zero.

    Left as they are, enough such rows would make a V22 of them whose condition number is
    excellent.
    """
    basis, _ = np.linalg.qr(vectors)
    basis[np.linalg.norm(basis, axis=1) < precision] = 0.0
    return basis


@dataclass(frozen=True)
class _Noise:
    """Relative singular values that rounded geometry makes, and the rank above them."""

    level: float
    rank: int
    gap: float
    shortest: float  # norm of a column with an effect, in common units
    source: str


def _geometry_noise(observation: Observation) -> _Noise | None:
    """The noise of an observation of rounded geometry; None where none of its values is noise.

    Singular values that are evidence of rank stay nearly the same for other geometry that the file
    would write alike; what changes by a part of itself is made by the rounding.
    """
    geometry = observation.geometry
    if geometry is None or not observation.factor.any():
        return None
    scales = _scales(observation)
    written = np.linalg.svd(observation.factor * scales, compute_uv=False)
    written, largest = written / written[0], float(written[0])
    floor = max(ROUND_OFF * len(written), SECOND_ORDER * geometry.relative)
    counted = int((written > floor).sum())
    if written[counted - 1] > min(REACH * geometry.relative, FARTHEST):
        return None
    source = f"geometry known to {geometry.accuracy:.1g} m only ({geometry.source})"
    for draws, least in DRAWS:
        spectra = np.linalg.svd(geometry.factors(draws) * scales, compute_uv=False)
        spectra = np.asarray(spectra / spectra[0, 0], dtype=np.float64)[:, :counted]
        change = np.sqrt(((spectra[1:] - spectra[0]) ** 2).mean(axis=0))
        noisy = change > least * spectra[0]
        if not noisy.any():
            near = written[counted - 1] < NEAR_INVERSE * geometry.relative
            if near and not geometry.presumed:
                text = (
                    f"the condition number {1 / written[counted - 1]:.1e}, columns in common units,"
                )
                warn(f"{text} is near the inverse of the accuracy: {source}", AccuracyWarning)
            return None
    level = float(spectra[:, noisy].max())
    first, last = int(noisy.argmax()), int(np.flatnonzero(noisy).max()) + 1
    rank = int((written > level).sum())
    gap = float(written[rank - 1] / level) if rank else 0.0
    if gap >= CLEAR_OF_NOISE:
        text = f"{counted - rank} singular values are made by rounded numbers and do not count"
        warn(f"{text}: {source}; the rank is {rank} without them", AccuracyWarning)
        return _Noise(level, rank, gap, level * np.sqrt(gap) * largest, source)
    combinations = _decomposed(observation.factor * scales)[1][first:last]
    text = (
        f"between {first} and {last}: other numbers that the robot file would round alike change "
        f"relative singular values of up to {level:.1e} ({source}), and the rest is less than "
        f"{CLEAR_OF_NOISE:g} times larger; "
        f"{_concerned(observation, np.arange(len(scales)), combinations)}"
    )
    if not geometry.presumed:
        raise RankError(f"the rank is ambiguous {text}")
    warn(f"the rank may be {text}", AccuracyWarning)
    return None


def _concerned(
    observation: Observation,
    columns: IntArray,
    combinations: FloatArray,
    made: float = 0.0,
) -> str:
    """What combinations (k, n) of the parameters in columns are of, and what to do about them.

    Where a rounding may have ``made`` them, in m, it is asked for.
    """
    weight = np.abs(combinations).max(axis=0, initial=0.0)
    leading = np.argsort(-weight.round(DIGITS), kind="stable")[:NAMED]
    names = [observation.parameters[columns[k]] for k in sorted(leading) if weight[k] > 0]
    text, how = ", ".join(name.label for name in names), "write its numbers with more digits"
    if made:
        rounding = _rounding(made, observation)
        how += f", or, if they are rounded, say so by --rounding {rounding:g}"
    if observation.geometry is not None:
        places = observation.geometry.places
        loops = dict.fromkeys(loop for name in names for loop in places.get(name.link, ()))
        text += f" of loop {', '.join(loops)}" if loops else ""
        alike = "; ".join(observation.geometry.alike[:NAMED])
        if alike:
            how += f", or alike what is meant to be equal, as --snap makes it: {alike}"
        elif not made:
            how += ", or, if they are exact, say so by --rounding 0"
    return f"it is about {text}: {how}"


def _rounding(least: float, observation: Observation) -> float:
    """A rounding to ask for, in m: not one that was tried."""
    tried = 0.0 if observation.geometry is None else observation.geometry.accuracy
    return max(float(10.0 ** np.ceil(np.log10(least))), COARSER * tried)


def _scales(observation: Observation) -> FloatArray:
    """Factors (n,) that bring columns of all units to that of one per kg."""
    return np.asarray(observation.length ** observation.parameters.length_powers.astype(np.float64))


def decide_rank(
    singular_values: FloatArray, round_off: FloatArray | float = 0.0
) -> tuple[int, float]:
    """Rank and gap of descending singular values; RankError unless just one gap is wide.

    Values up to ``round_off`` are that, whatever their size.
    """
    values = np.asarray(singular_values, dtype=np.float64) / singular_values[0]
    # Round-off leaves about this much of an exact zero: how far below a value is means nothing.
    floor = len(values) * np.finfo(float).eps
    counted = np.where(singular_values > round_off, values, 0.0)
    floored = np.append(np.maximum(counted, floor), floor)
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


def without_effect(observation: Observation) -> bool:
    """Whether all columns are zero."""
    norms, largest = _column_norms(observation)
    return bool((norms <= ZERO_COLUMN * largest).all())


def _column_norms(observation: Observation) -> tuple[FloatArray, float]:
    """Norms (n,) of columns in one unit, and what the largest one is at least."""
    norms = np.linalg.norm(observation.factor, axis=0) * _scales(observation)
    natural = observation.natural_size * np.sqrt(observation.rows)
    return norms, max(float(norms.max(initial=0.0)), natural)


def _nonzero_columns(observation: Observation, noise: _Noise | None) -> tuple[IntArray, str]:
    """Columns with an effect; and in words the first that is neither zero nor clearly not."""
    norms, largest = _column_norms(observation)
    if without_effect(observation):
        raise RankError(
            "no parameter has an effect: every column of the regressor is zero, as at rest where "
            "gravity moves no joint: choose the full model, or another 'gravity' in a YAML"
        )
    relative = norms / largest
    if noise is not None:
        return np.flatnonzero(norms > noise.shortest), ""
    zero, geometry = ZERO_COLUMN, observation.geometry
    if geometry is not None and not geometry.presumed:  # products of two roundings
        size = np.linalg.norm(observation.factor * _scales(observation), 2) / largest
        zero = max(zero, SECOND_ORDER * geometry.relative * float(size))
    doubtful = (relative > zero) & (relative < MINIMUM_RANK_GAP * ZERO_COLUMN)
    told = ""
    if doubtful.any():
        column = int(np.flatnonzero(doubtful)[0])
        made = float(relative[doubtful].max() * observation.length)
        rounding = _rounding(max(made, SIX_DIGITS), observation)
        told = (
            f"column {observation.parameters[column].label} is neither zero nor clearly not: "
            f"{relative[column]:.1e} of the largest (zero below {zero:.0e}, an effect above "
            f"{MINIMUM_RANK_GAP * ZERO_COLUMN:g}): write the robot's numbers with more digits, or, "
            f"if they are rounded, say so by --rounding {rounding:g} without --snap"
        )
    return np.flatnonzero(relative > zero), told


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


def regrouping_matrix(
    null_basis: FloatArray, dependent: IntArray, zero: float = ZERO_COEFFICIENT
) -> FloatArray:
    """Coefficients β of Φ_base = Φ_B + β Φ_D.

    Parameters
    ----------
    null_basis : FloatArray
        (n, d).
    dependent : IntArray
        (d,), or (c, d) for c choices at once.
    zero : float
        Coefficients below this fraction of the largest, or of 1, are none.

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
    beta[np.abs(beta) <= zero * np.maximum(largest, 1.0)[:, None, None]] = 0.0
    return beta if np.ndim(dependent) == 2 else beta[0]
