"""The choice of the dependent parameters, what all searches share, and the one that tries all.

Ties are broken alike by all that list them: fewest terms first, then the smallest coefficients,
then the dependent columns that come first. So the answer is unique.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, combinations, islice
from math import comb, inf
from time import perf_counter
from typing import ClassVar

import numpy as np

from loopid.arguments import (
    FloatArray,
    IntArray,
    checked,
    checked_fields,
)
from loopid.base_parameters.structure import (
    Structure,
    base_columns,
    regrouping_matrix,
)
from loopid.errors import (
    OptionError,
    SearchError,
)
from loopid.workers import (
    Progress,
    one_blas_thread,
)

# cond(V22), the paper's; and cond(W_B), the amplification of noise in the estimates.
CRITERIA = ("nullspace", "regressor")
# Choices whose condition numbers differ by less than this fraction are ties.
TIE_TOLERANCE = 1e-9
# Sums of coefficients that differ by less than this are equal.
EQUAL_COEFFICIENTS = 1e-6
BATCH = 1 << 22  # numbers in the regrouping matrices that are in memory together
# Columns of W up to this fraction of its norm are round-off, and no choice keeps them.
ROUND_OFF_COLUMN = 1e-13
# Of the search that tries all: combinations, and those whose matrices are in memory together.
MOST_CANDIDATES, CHUNK = 2_000_000_000, 1 << 14
# Round-off of a determinant, relative, for matrices that could be the best.
DETERMINANT_SLACK = 1e-6
MOST_TIES = 20_000  # selections among which the most readable is chosen; the others are counted


@checked_fields
@dataclass(frozen=True)
class ChoiceProblem:
    """Choose d of n parameters to be dependent, so that the criterion is least.

    Both criteria ask for k of n vectors with the least condition number: ``nullspace`` selects
    the d rows of V2 that make V22, ``regressor`` the r columns of W that make W_B.

    Attributes
    ----------
    structure : Structure
    criterion : str
        One of ``CRITERIA``.

    Raises
    ------
    OptionError
        For an unknown criterion.
    """

    structure: Structure
    criterion: str = "nullspace"

    def __post_init__(self) -> None:
        if self.criterion not in CRITERIA:
            raise OptionError.unknown("criterion", self.criterion, CRITERIA)

    @property
    def size(self) -> int:
        """Number n of parameters with an effect."""
        return len(self.structure.columns)

    @property
    def dependent_count(self) -> int:
        """Number d of dependent parameters."""
        return self.size - self.structure.rank

    @property
    def candidates(self) -> int:
        """Number of combinations, C(n, d)."""
        return comb(self.size, self.dependent_count)

    @property
    def vectors(self) -> FloatArray:
        """The n vectors (n, k), k of which are to be selected, scaled to a norm of 1."""
        if self.criterion == "nullspace":
            return self.structure.null_basis
        columns = self.structure.row_factor.T / np.linalg.norm(self.structure.row_factor, 2)
        columns[np.linalg.norm(columns, axis=1) <= ROUND_OFF_COLUMN] = 0.0
        return np.asarray(columns, dtype=np.float64)

    def dependent(self, selections: IntArray) -> IntArray:
        """Dependent columns (c, d) of selections (c, k) of vectors."""
        if self.criterion == "nullspace":
            return np.sort(selections, axis=1)
        rest = [base_columns(self.size, selection) for selection in selections]
        return np.array(rest, dtype=np.int64).reshape(len(selections), self.dependent_count)

    def condition_number(self, dependent: IntArray) -> float:
        """The criterion's value for dependent columns (d,)."""
        chosen = np.asarray(dependent)
        if self.criterion == "regressor":
            chosen = base_columns(self.size, chosen)
        return float(condition_numbers(self.vectors[chosen][None])[0])


def condition_numbers(matrices: FloatArray) -> FloatArray:
    """Condition numbers (c,) of matrices (c, m, n): 1 for empty, infinite for singular ones."""
    if 0 in matrices.shape[1:]:
        return np.ones(len(matrices))
    values = np.linalg.svd(matrices, compute_uv=False)
    largest, smallest = values[:, 0], values[:, -1]
    ratio = np.full(len(values), np.inf)
    np.divide(largest, smallest, out=ratio, where=smallest > 0)
    return ratio


@dataclass(frozen=True, eq=False)
class Exclusion:
    """A box of eigenvalues that no selection of a block lies in, and the tree that shows it."""

    block: int  # which block of the problem
    vectors: FloatArray  # (m, k), k rows of which are to be selected
    # No selection has all eigenvalues of X_S X_Sᵀ in this open range
    above: float
    below: float
    # For each leaf the rows taken and the rows left out there. Every selection agrees with exactly
    # one leaf
    leaves: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]


@dataclass(frozen=True)
class SearchResult:
    """What a search found.

    Attributes
    ----------
    name, criterion : str
    dependent : tuple of int or None
        Dependent columns, ascending, among those with an effect; None where nothing was found.
    condition_number : float
        The criterion's value; infinite where nothing was found.
    certified : bool
        Whether no choice is better by more than ``tolerance`` times the value, and the choice
        among ties is final: it depends neither on the processor nor on the time limit.
    reason : str
        Why an exact search is not certified: the time limit, round-off, or near ties.
    gap : float
        No choice has a condition number of less than the value over this, up to ``tolerance``: 1
        where it is certified, infinite where nothing was proven.
    candidates : int
        Number of combinations there are.
    evaluated : int
        Number of combinations that were looked at one by one.
    nodes : int
        Nodes of the search tree, 0 for strategies without one.
    ties : int or None
        Number of best choices; None where they were not counted.
    tolerance : float
        Relative; see ``certified``.
    seconds : float
    record : tuple of Exclusion
        The proof, where ``ExactSearch`` was asked to keep it.
    """

    name: str
    criterion: str
    dependent: tuple[int, ...] | None
    condition_number: float
    certified: bool
    candidates: int
    evaluated: int
    nodes: int = 0
    ties: int | None = None
    gap: float = inf
    tolerance: float = TIE_TOLERANCE
    reason: str = ""
    seconds: float = 0.0
    record: tuple[Exclusion, ...] = field(default=(), repr=False)

    @property
    def found(self) -> bool:
        """Whether there is an answer at all."""
        return self.dependent is not None

    def __repr__(self) -> str:
        proven = "certified" if self.certified else f"not certified, gap {self.gap:.4g}"
        proven += f" ({self.reason})" if self.reason else ""
        ties = "ties not counted" if self.ties is None else f"{self.ties:,} tied"
        return (
            f"SearchResult({self.name}, {self.criterion}: {self.condition_number:.6g}, {proven}, "
            f"{ties}, {self.seconds:.3g} s)"
        )


class SearchStrategy(ABC):
    """A way of choosing the dependent parameters."""

    name: ClassVar[str]

    def search(self, problem: ChoiceProblem) -> SearchResult:
        """Solve a choice problem, on one BLAS thread: the matrices are small.

        Raises
        ------
        SearchError
            Where the strategy cannot be applied.
        """
        start = perf_counter()
        with one_blas_thread():
            result = self._search(problem) if problem.dependent_count else self._no_choice(problem)
        return replace(result, seconds=perf_counter() - start)

    @abstractmethod
    def _search(self, problem: ChoiceProblem) -> SearchResult: ...

    def _no_choice(self, problem: ChoiceProblem) -> SearchResult:
        """The only answer where every parameter is a base parameter."""
        return SearchResult(
            name=self.name,
            criterion=problem.criterion,
            dependent=(),
            condition_number=problem.condition_number(np.empty(0, dtype=np.int64)),
            certified=True,
            candidates=1,
            evaluated=1,
            ties=1,
            gap=1.0,
        )


@dataclass(frozen=True)
class Readability:
    """What makes a choice readable: few terms, small coefficients."""

    terms: int
    coefficients: float
    dependent: tuple[int, ...]

    def __add__(self, other: Readability) -> Readability:
        return Readability(
            self.terms + other.terms,
            self.coefficients + other.coefficients,
            tuple(sorted(self.dependent + other.dependent)),
        )


NOTHING = Readability(0, 0.0, ())


def most_readable(choices: Iterable[Readability]) -> Readability:
    """The first choice in the order of terms, coefficients and columns."""
    every = list(choices)
    terms = min(choice.terms for choice in every)
    every = [choice for choice in every if choice.terms == terms]
    enough = min(choice.coefficients for choice in every) + EQUAL_COEFFICIENTS
    every = [choice for choice in every if choice.coefficients <= enough]
    return min(every, key=lambda choice: choice.dependent)


def readabilities(
    null_basis: FloatArray, choices: IntArray, columns: IntArray | None = None
) -> Iterator[Readability]:
    """Readability of several choices (c, d) of rows of a null basis (n, d), one after another.

    ``columns`` (n,) are those that the rows belong to, if not 0 ... n - 1.
    """
    names = choices if columns is None else columns[choices]
    size = max(1, BATCH // null_basis.size)
    for start in range(0, len(choices), size):
        part = slice(start, start + size)
        beta = np.abs(regrouping_matrix(null_basis, choices[part]))
        terms, totals = (beta > 0).sum(axis=(1, 2)).tolist(), beta.sum(axis=(1, 2)).tolist()
        for count, total, own in zip(terms, totals, names[part].tolist(), strict=True):
            yield Readability(count, total, tuple(sorted(own)))


class ExhaustiveSearch(SearchStrategy):
    """Gautier's search: evaluate every one of the C(n, d) combinations [Gautier1991].

    Each is judged by a determinant, which costs a fifth of its singular values. With all singular
    values between σ_max / κ and σ_max, |det| >= σ_max^k / κ^(k-1), and σ_max is at least the root
    mean square of the singular values, ‖X_S‖_F / sqrt(k). A combination whose determinant is
    smaller cannot have a condition number κ; only the others get their singular values computed.

    Parameters
    ----------
    progress : callable, optional
        Called with the numbers of combinations done and in all.
    """

    name = "exhaustive"

    @checked
    def __init__(self, progress: Progress | None = None) -> None:
        self.progress = progress

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        total, vectors = problem.candidates, problem.vectors
        if total > MOST_CANDIDATES:
            raise SearchError(
                f"exhaustive search would evaluate C({problem.size}, {problem.dependent_count}) = "
                f"{total:,} combinations (bound {MOST_CANDIDATES:,}): use search='exact'"
            )
        size, count = vectors.shape
        best, least, ties = np.empty((0, count), dtype=np.int64), np.inf, 0
        every = combinations(range(size), count)
        for done in range(0, total, CHUNK):
            numbers = chain.from_iterable(islice(every, CHUNK))
            selections = np.fromiter(numbers, np.int64).reshape(-1, count)
            kept, found = promising(vectors, selections, least)
            lowest = float(found.min(initial=np.inf))
            if least > lowest * (1 + TIE_TOLERANCE):
                best, ties = best[:0], 0
            least = min(least, lowest)
            tied = kept[(found <= least * (1 + TIE_TOLERANCE)) & (found < np.inf)]
            best, ties = np.concatenate([best, selections[tied]])[:MOST_TIES], ties + len(tied)
            if self.progress is not None:
                self.progress(min(done + CHUNK, total), total)
        chosen = most_readable(readabilities(problem.structure.null_basis, problem.dependent(best)))
        return SearchResult(
            name=self.name,
            criterion=problem.criterion,
            dependent=chosen.dependent,
            condition_number=problem.condition_number(np.array(chosen.dependent)),
            certified=True,
            gap=1.0,
            candidates=total,
            evaluated=total,
            ties=ties,
        )


def promising(
    vectors: FloatArray, selections: IntArray, least: float
) -> tuple[IntArray, FloatArray]:
    """Which of some selections (c, k) may reach a condition number, and theirs."""
    matrices, count = vectors[selections], selections.shape[1]
    mean = np.sqrt((vectors**2).sum(axis=1)[selections].sum(axis=1) / count)
    # One power of a quotient: a power of the condition number alone could overflow.
    quotient = mean / (least * (1 + TIE_TOLERANCE))
    enough = mean * quotient ** (count - 1) * (1 - DETERMINANT_SLACK)
    kept = np.flatnonzero(np.abs(np.linalg.det(matrices)) >= enough)
    return kept, condition_numbers(matrices[kept])
