"""How many combinations of parameters an observation shows: one rule for all callers.

Columns are brought to common units: of one per kg, with lengths measured by the characteristic
length. A singular value then says how much of all forces depends on a combination. It counts when
neither round-off nor the rounding of the robot file could have made it. Where that is not clear it
does not count, and the combination is listed as doubtful. Without a gap between the values that
count and the others the rank itself is unclear. Bounds say between which numbers it lies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg

from loopid.arguments import BoolArray, FloatArray, IntArray, Positive
from loopid.errors import AccuracyWarning, OptionError, RankError, warn
from loopid.numbers import ROUND_OFF
from loopid.observation import Observation
from loopid.parameters import KINDS
from loopid.records import record

SHOWN = 4  # parameters that a warning names
TRIED = 1e-4  # of the characteristic length: rounding that shows what doubtful values take
EQUAL = 1e-6  # relative; round-off decides no pivot
SHORTEST = 1e-15  # of the largest column: shorter ones are round-off
SPANNED = 1e-6  # of a column: what is farther from a span is not in it
DIGITS = 6  # nor the order of combinations
SHORT = 1e-2  # of the least combination that counts
SLIGHT = 1e-3  # of the largest term: smaller ones are left out of doubtful combinations


# Part of itself, in the median, by which a singular value changes with other numbers that the file
# would round alike, if it is they that make it; and other geometries that are tried to see that.
CHANGE, DRAWS = 0.02, 8
# They are tried where the least singular value that is not round-off is below a multiple of the
# accuracy of the file, over the characteristic length, and below a part of the largest.
REACH, SMALL = 1e3, 1e-2
# Where the file does not state its accuracy, they are tried where that value is fainter, with
# lengths presumed to be off by a part of the characteristic length.
FAINT, PRESUMED = 1e-5, 1e-6
# Ratio of the last singular value that counts to the next from which on a rank is clear.
CLEAR = 1e3


@record(kw_only=True, checked=True)
class RankTolerances:
    """What decides a rank. All are relative to the largest singular value or column.

    Attributes
    ----------
    least : float
        Singular values up to this never count. Robots whose geometry is exact have none between
        1e-13 and 1e-5: 90 robots in others' files, with fixed and with floating bases.
    zero : float
        Up to this a singular value or a column is round-off, and not even doubtful.

    Raises
    ------
    OptionError
        Unless both are above 0, and ``least`` between ``zero`` and 1.

    Examples
    --------
    >>> import loopid
    >>> loopid.base_parameters.RankTolerances(least=1e-5).zero
    1e-12
    """

    least: Positive = 1e-7
    zero: Positive = 1e-12

    def __post_init__(self) -> None:
        if not self.zero <= self.least < 1:
            raise OptionError("least must be from zero on and below 1", given=self.least)


@record
class DoubtfulCombination:
    """A combination of parameters that may have an effect or not. It does not count."""

    terms: Mapping[str, float]  # labels to factors, the leading one first
    # How much forces depend on it, relative to the combination that they depend on most
    singular_value: float
    # In m, of the lengths in the robot file: numbers rounded so make such a value. NaN where the
    # robot is not known, or said to be exact
    rounding: float
    source: str = ""  # where it is known that the file is rounded so; empty where it need not be


@record
class Rank:
    """The rank of an observation, and how clear it is."""

    value: int
    gap: float  # last singular value that counts over the next one, or over round-off
    # (n,), relative to the largest, of columns in common units, descending
    singular_values: FloatArray
    scales: FloatArray  # (p,), factors that bring all columns to common units
    columns: IntArray  # (n,), columns with an effect
    doubtful: tuple[DoubtfulCombination, ...]
    # Between which numbers it lies where the gap is not clear; None where it is
    bounds: tuple[int, int] | None


def decide_rank(observation: Observation, tolerances: RankTolerances) -> Rank:
    """Decide the rank; a RankError says that no parameter has an effect, or rows are too few."""
    scales, norms, largest = _common_units(observation, tolerances)
    effective = norms > tolerances.zero * largest
    columns = np.flatnonzero(effective)
    if not len(columns):
        raise RankError(
            "no parameter has an effect: every column of the regressor is zero, as at rest where "
            "gravity moves no joint: choose the full model, or another 'gravity' in a YAML"
        )
    sizes, right = decomposed((observation.factor * scales)[:, columns])
    values = sizes / sizes[0]
    directions = np.zeros((len(right), len(scales)))
    directions[:, columns] = right
    counted, last = _not_round_off(observation, scales, values, directions, tolerances)
    rank, source = _counted(observation, scales, values[:last], counted)
    if rank == observation.rows < len(columns):
        raise RankError(
            f"the rank may be larger: it equals the number of rows, {rank}, so more samples are "
            f"needed to decide how many of the {len(columns)} parameters are independent",
            rank=rank,
            parameters=len(columns),
        )
    below = np.append(values, 0.0)[rank]
    doubtful: tuple[DoubtfulCombination, ...] = ()
    if last > rank:
        forces = values[rank:last, None] * directions[rank:last]
        doubtful = _combinations(observation, forces, scales, source)
        # Columns have no effect that counts where they are so much shorter than what counts.
        shortest = sizes[0] * min(np.sqrt(values[rank - 1] * below), SHORT * values[rank - 1])
        effective = norms > shortest
    some = ~effective & (norms > SHORTEST * largest)
    effective |= _spanned(observation.factor * scales, effective, some, rank)
    gap = float(values[rank - 1] / max(below, np.finfo(float).eps))
    bounds = None
    if gap < CLEAR:
        ends = CLEAR * below, values[rank - 1] / CLEAR
        lowest, highest = (int((values > end).sum()) for end in ends)
        bounds = max(lowest, 1), highest
    return Rank(rank, gap, values, scales, np.flatnonzero(effective), doubtful, bounds)


def warn_of_doubts(
    doubtful: Sequence[DoubtfulCombination], bounds: tuple[int, int] | None = None
) -> None:
    """Say which combinations do not count, what may have made them, and whether it is clear."""
    if bounds:
        warn(
            f"the rank is unclear: it lies between {bounds[0]} and {bounds[1]}, as no gap parts "
            "singular values that count from the others",
            AccuracyWarning,
        )
    if not doubtful:
        return
    names, most = [next(iter(one.terms)) for one in doubtful], doubtful[0]
    listed = ", ".join(names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
    by = f", as a rounding of {most.rounding:.0e} m makes" if most.rounding > 0 else ""
    if most.source:
        by = f", and numbers known to {most.rounding:.1g} m only ({most.source}) make such"
    many = f"{len(names)} doubtful combinations of parameters, led by {listed}, do not count"
    if len(names) == 1:
        many = f"a doubtful combination of parameters, led by {listed}, does not count"
    warn(
        f"{many}: singular values are at most {most.singular_value:.1e} of the largest{by}",
        AccuracyWarning,
    )


def without_effect(observation: Observation) -> bool:
    """Whether no parameter has an effect."""
    tolerances = RankTolerances()
    _, norms, largest = _common_units(observation, tolerances)
    return bool((norms <= tolerances.zero * largest).all())


def _common_units(
    observation: Observation, tolerances: RankTolerances
) -> tuple[FloatArray, FloatArray, float]:
    """Scales and then norms (p,) of columns, and what the largest norm is at least.

    Columns of bodies that are longer than the natural size, as of rotors behind gears, are made as
    large as that. Terms of joints have units of their own: those with a clear effect are made as
    large as the largest column.
    """
    powers = observation.parameters.length_powers.astype(np.float64)
    scales = np.asarray(observation.length**powers)
    norms = np.linalg.norm(observation.factor, axis=0) * scales
    of_joint = np.array([p.kind not in KINDS for p in observation.parameters], dtype=bool)
    largest = observation.natural_size * np.sqrt(observation.rows)
    largest = largest or float(norms[~of_joint].max(initial=0.0))
    largest = largest or float(norms.max(initial=0.0))
    long = norms > largest
    long |= of_joint & (norms > tolerances.least * largest)
    scales[long] *= largest / norms[long]
    norms[long] = largest
    return scales, norms, largest


def _spanned(matrix: FloatArray, effective: BoolArray, short: BoolArray, rank: int) -> BoolArray:
    """Which of some short columns (p,) of a matrix (m, p) lie in the span of those with an effect.

    Round-off does not: however short they are, they have an effect.
    """
    if short.any():
        long = matrix[:, effective]
        span = np.linalg.svd(long / np.linalg.norm(long, axis=0))[0][:, :rank]
        columns = matrix[:, short] / np.linalg.norm(matrix[:, short], axis=0)
        apart = np.linalg.norm(columns - span @ (span.T @ columns), axis=0)
        short[short] = apart <= SPANNED
    return short


def decomposed(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Singular values and all right singular vectors, as rows.

    LAPACK's divide and conquer does not converge for some matrices without full rank; QR does.
    """
    try:
        _, values, right = np.linalg.svd(matrix)
    except np.linalg.LinAlgError:
        _, values, right = scipy.linalg.svd(matrix, lapack_driver="gesvd")
    return values, right


def _not_round_off(
    observation: Observation,
    scales: FloatArray,
    values: FloatArray,
    directions: FloatArray,
    tolerances: RankTolerances,
) -> tuple[int, int]:
    """How many singular values (n,) of directions (n, p) count, and are no round-off.

    Near singular poses round-off is large; so is what other geometry would change. A value that
    numbers of all digits would make is none. One that only lengths larger than the robot would
    make counts.
    """
    ends = tolerances.least, tolerances.zero
    counted, last = (max(1, int((values > end).sum())) for end in ends)
    if last == counted:
        return counted, last
    part = slice(counted, last)
    roundings = _roundings(observation, scales, directions[part], values[part], known=False)
    real = np.flatnonzero(~(roundings <= ROUND_OFF * observation.length))
    # Coarse values that the caller leaves out are left out, real or not.
    usual = tolerances.least <= RankTolerances.least
    effects = np.flatnonzero(usual & (roundings > observation.length))
    last = counted + int(real.max(initial=-1)) + 1
    return counted + int(effects.max(initial=-1)) + 1, last


def _counted(
    observation: Observation, scales: FloatArray, values: FloatArray, counted: int
) -> tuple[int, str]:
    """How many relative singular values count; and what shows the rounding that made the rest.

    From the least one on, values that other numbers of the robot file would change are made by its
    rounding. The first that stays the same is evidence of rank. So are all above it.
    """
    draws, least = observation.draws, values[-1]
    if draws is None:
        return counted, ""
    accuracy, near = draws.accuracy, REACH * draws.accuracy / observation.length
    if not accuracy and not draws.source:
        accuracy, near = PRESUMED * observation.length, FAINT
    if not accuracy or least > min(near, SMALL):
        return counted, ""
    # A few draws see whether there may be any.
    for count, part in ((2, CHANGE / 10), (DRAWS, CHANGE)):
        factors = draws.rounded(count, accuracy if not draws.accuracy else None)
        spectra = np.linalg.svd(factors * scales, compute_uv=False)[:, :counted]
        changes = np.median(np.abs(spectra[1:] - spectra[0]), axis=0)  # single ones are singular
        same = np.flatnonzero(changes <= part * spectra[0])
        if len(same) and same[-1] == counted - 1:
            return counted, ""
    return (int(same[-1]) + 1 if len(same) else 1), draws.source


def _combinations(
    observation: Observation, forces: FloatArray, scales: FloatArray, source: str
) -> tuple[DoubtfulCombination, ...]:
    """Combinations that span those of some forces (k, p) in common units.

    Each has a parameter that the others do not have. So they do not depend on the choice of vectors
    for equal singular values.
    """
    labels = observation.parameters.labels
    basis = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    leaders = pivots(basis.T, len(basis))
    rows = np.linalg.inv(basis[:, leaders]) @ basis
    along = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    sizes = np.linalg.norm(forces @ along.T, axis=0)
    roundings, found = _roundings(observation, scales, along, sizes, known=bool(source)), []
    if _exact(observation):
        roundings = np.full(len(sizes), np.nan)
    for k in np.argsort(-np.log10(sizes).round(DIGITS), kind="stable"):
        leader, row = leaders[k], rows[k]
        kept = np.flatnonzero(np.abs(row) > SLIGHT * np.abs(row).max())
        order = [leader, *kept[kept != leader]]
        terms = {labels[j]: float(row[j] / scales[j] * scales[leader]) for j in order}
        found.append(DoubtfulCombination(terms, float(sizes[k]), float(roundings[k]), source))
    return tuple(found)


def _roundings(
    observation: Observation,
    scales: FloatArray,
    along: FloatArray,
    sizes: FloatArray,
    *,
    known: bool,
) -> FloatArray:
    """Rounding (k,) in m: the ``known`` one, or one that makes as large forces along directions.

    NaN where the robot is not known.
    """
    if observation.draws is None:
        return np.full(len(sizes), np.nan)
    if known:
        return np.full(len(sizes), observation.draws.accuracy)
    tried = TRIED * observation.length
    written, *others = observation.draws.rounded(2, tried) * scales
    own, *moved = (np.linalg.norm(factor @ along.T, axis=0) for factor in (written, *others))
    made = np.sqrt(np.mean((np.array(moved) - own) ** 2, axis=0)) / np.linalg.norm(written, 2)
    return np.asarray(tried * sizes / np.maximum(made, np.finfo(float).tiny))


def _exact(observation: Observation) -> bool:
    """Whether the geometry is said to be exact, as ``rounding=0`` does."""
    draws = observation.draws
    if draws is None or not draws.source:
        return False
    return draws.accuracy <= ROUND_OFF * observation.length


def pivots(vectors: FloatArray, count: int) -> IntArray:
    """Rows (count,) of vectors (n, m) in the order of pivoted QR; round-off decides no pivot."""
    basis, along = np.empty((count, vectors.shape[1])), np.empty((len(vectors), count))
    squares = np.einsum("ij,ij->i", vectors, vectors)  # of what is left of each vector
    exact, chosen = squares.copy(), np.empty(count, dtype=np.int64)
    for k in range(count):
        norms = np.sqrt(np.maximum(squares, 0.0))
        norms[chosen[:k]] = -1.0
        chosen[k] = pivot = int(np.argmax(norms >= norms.max() * (1 - EQUAL)))
        rest = vectors[pivot].copy()
        for _ in range(2):  # once more for what round-off left
            rest -= (basis[:k] @ rest) @ basis[:k]
        basis[k] = rest / (np.linalg.norm(rest) or 1.0)
        along[:, k] = vectors @ basis[k]
        squares -= along[:, k] ** 2
        # What is left of a vector after much was taken away is round-off: it is found anew.
        if len(lost := np.flatnonzero(squares < EQUAL * exact)):
            left = vectors[lost] - along[lost, : k + 1] @ basis[: k + 1]
            squares[lost] = exact[lost] = np.einsum("ij,ij->i", left, left)
    return chosen
