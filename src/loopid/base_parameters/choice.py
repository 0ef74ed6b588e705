"""The choice of the dependent parameters: the problem, and what all searches share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from math import ceil, comb, inf, log10, sqrt
from time import thread_time
from typing import Any, ClassVar

import numpy as np
from pydantic import PositiveInt

from loopid.arguments import FloatArray, IntArray, Number, Positive
from loopid.base_parameters.account import SubgroupAccount
from loopid.base_parameters.rank import pivots
from loopid.base_parameters.structure import Structure, base_columns, regrouping_matrix
from loopid.errors import OptionError
from loopid.numbers import SUM_ROUND_OFF, UNIT_ROUND_OFF
from loopid.records import record
from loopid.workers import one_blas_thread

# cond(V22), the paper's; and cond(W_B), the amplification of noise in the estimates.
CRITERIA = ("nullspace", "regressor")
UNCLEAR_RANK = "unclear rank"  # a reason why nothing is certified
# No certificate is given to a coarser one: digits that tie would then be digits that count.
MOST_TOLERANCE = 1e-6
CERTAIN = 1e-2  # relative error of a vector that is not zero
TERM = 1e-9  # of the largest coefficient, or of 1: smaller ones do not make a choice harder to read
EQUAL_COEFFICIENTS = 1e-6  # sums of coefficients that differ by less are equal
BATCH = 1 << 22  # numbers in the regrouping matrices that are in memory together


@record(kw_only=True, checked=True)
class SearchOptions:
    """How far a search goes, and how exact it is.

    Attributes
    ----------
    time_limit : float
        In s of processor time, so that other programs change nothing, after which exact search
        returns the best so far, not certified.
    tolerance : float
        Choices whose condition numbers differ by less than this fraction are ties. Round-off may
        ask for more; what was used is returned.
    nodes : int
        Nodes of each rule for a box at the first attempt, four times as many at each further one
        and for the ties of a block.
    ties : int
        Ties of a block that are listed at most: the most readable is chosen.
        Where there are more, the dependent columns that come first decide.
    memory : int
        In bytes, that the combinations and matrices of a group of subgroup search may take.

    Raises
    ------
    OptionError
        Unless all are above 0.

    Examples
    --------
    >>> import loopid
    >>> observation = loopid.regressors.structural_observation(loopid.load("four_bar"))
    >>> minute = loopid.base_parameters.SearchOptions(time_limit=60.0)
    >>> loopid.base_parameters.find_base(observation, options=minute).search.options.time_limit
    60.0
    """

    time_limit: Positive = 10.0
    tolerance: Positive = 1e-9
    nodes: PositiveInt = 1024
    ties: PositiveInt = 20_000
    memory: PositiveInt = 2**30

    def covering(self, error: Number) -> float:
        """The tolerance, or in decades what covers a relative error four times."""
        if not error < inf:
            return inf
        decades = ceil(log10(4 * error / self.tolerance)) if error > 0 else 0
        return float(f"{self.tolerance * 10.0 ** max(0, decades):.12g}")


@record(checked="outside")
class ChoiceProblem:
    """Choose d of n parameters to be dependent, so that the criterion is least.

    Both criteria ask for k of n vectors with the least condition number. ``nullspace`` selects the
    d rows of V2 that make V22. ``regressor`` selects the r columns of W that make W_B.

    Attributes
    ----------
    structure : Structure
    criterion : str
        One of ``CRITERIA``.

    Raises
    ------
    OptionError
        For an unknown criterion.

    Examples
    --------
    >>> import loopid
    >>> W = loopid.regressors.structural_observation(loopid.load("four_bar"))
    >>> structure = loopid.base_parameters.find_base(W).structure
    >>> problem = loopid.base_parameters.ChoiceProblem(structure)
    >>> problem.size, problem.dependent_count, problem.candidates
    (7, 3, 35)
    """

    structure: Structure
    criterion: str = "nullspace"

    def __post_init__(self) -> None:
        OptionError.require("criterion", self.criterion, CRITERIA)

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
        columns[np.linalg.norm(columns, axis=1) <= SUM_ROUND_OFF] = 0.0
        return np.asarray(columns, dtype=np.float64)

    def condition_number(self, dependent: IntArray) -> float:
        """The criterion's value for dependent columns (d,)."""
        return float(self.condition_numbers(np.asarray(dependent)[None])[0])

    def condition_numbers(self, dependent: IntArray) -> FloatArray:
        """The criterion's values (c,) for c choices (c, d) of dependent columns."""
        chosen = dependent
        if self.criterion == "regressor":
            is_base = np.ones((len(dependent), self.size), dtype=bool)
            np.put_along_axis(is_base, dependent, False, axis=1)
            chosen = np.nonzero(is_base)[1].reshape(len(dependent), -1)
        return condition_numbers(self.vectors[chosen])

    def uncertainty(self, condition: Number) -> float:
        """Relative error of condition numbers up to one given, by round-off in the vectors.

        All vectors of such a selection are at most ``condition`` times as long as its shortest. A
        vector with too few others that are as short is in none.
        """
        errors, (size, count) = self.structure.null_errors, self.vectors.shape
        if self.criterion == "regressor" or errors is None:
            moved = self.structure.factor_errors if self.criterion == "regressor" else None
            error = 0.0 if moved is None else float(moved.max())
            return 2 * sqrt(size) * (2 * UNIT_ROUND_OFF + error) * condition
        lengths = np.linalg.norm(self.vectors, axis=1)
        room = condition * (1 + errors) * lengths
        others = (lengths > 0) & (lengths <= room[:, None])
        taken = (lengths > 0) & (others.sum(axis=1) >= count)
        error = float(errors[taken].max(initial=0.0))
        if count == 1 and error < CERTAIN:  # any number alone has the same condition
            return 0.0
        return 2 * error * condition


def condition_numbers(matrices: FloatArray) -> FloatArray:
    """Condition numbers (c,) of matrices (c, m, n): 1 for empty, infinite for singular ones."""
    if 0 in matrices.shape[1:]:
        return np.ones(len(matrices))
    return largest_over_least(np.asarray(np.linalg.svd(matrices, compute_uv=False)))


def largest_over_least(values: FloatArray) -> FloatArray:
    """Ratios (c,) of the first to the last of singular values (c, k); infinite where that is 0."""
    ratio = np.full(len(values), np.inf)
    np.divide(values[:, 0], values[:, -1], out=ratio, where=values[:, -1] > 0)
    return ratio


@record(checked="outside")
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
        Why a search is not certified: the time limit, round-off, near ties, or an unclear rank.
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
    subgroups : SubgroupAccount or None
        What a subgroup search tried.
    options : SearchOptions
        How far the search was to go.

    Examples
    --------
    >>> import loopid
    >>> W = loopid.regressors.structural_observation(loopid.load("four_bar"))
    >>> found = loopid.base_parameters.find_base(W).search
    >>> found.name, found.certified, round(found.condition_number, 4), found.ties
    ('exact', True, 1.3396, 1)
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
    tolerance: float = SearchOptions.tolerance
    reason: str = ""
    seconds: float = field(default=0.0, compare=False)
    subgroups: SubgroupAccount | None = None
    options: SearchOptions = SearchOptions()

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


@record
class SearchStrategy(ABC):
    """A way of choosing the dependent parameters; a new one is a file and a line in ``SEARCHES``.

    Parameters
    ----------
    options : SearchOptions

    Examples
    --------
    >>> from loopid.base_parameters import SEARCHES, SearchStrategy
    >>> sorted(SEARCHES), all(issubclass(each, SearchStrategy) for each in SEARCHES.values())
    (['exact', 'qr', 'subgroup'], True)
    """

    name: ClassVar[str]

    options: SearchOptions = SearchOptions()

    def search(self, problem: ChoiceProblem) -> SearchResult:
        """Solve a choice problem, on one BLAS thread: the matrices are small.

        Raises
        ------
        OptionError
            Where the strategy cannot be applied.
        """
        start = thread_time()
        with one_blas_thread():
            if problem.dependent_count:
                result = self._search(problem)
            else:  # every parameter is a base parameter
                result = self._result(problem, (), certified=True, gap=1.0, evaluated=1, ties=1)
        return replace(result, seconds=thread_time() - start)

    @abstractmethod
    def _search(self, problem: ChoiceProblem) -> SearchResult: ...

    def _result(
        self, problem: ChoiceProblem, dependent: Iterable[int] | None, **found: Any
    ) -> SearchResult:
        """What was found of a problem."""
        chosen = None if dependent is None else tuple(map(int, dependent))
        value = inf if chosen is None else problem.condition_number(np.array(chosen, dtype=int))
        return SearchResult(
            name=self.name,
            criterion=problem.criterion,
            dependent=chosen,
            condition_number=value,
            candidates=problem.candidates,
            options=self.options,
            **found,
        )


@record(checked=True)
class PivotedQR(SearchStrategy):
    """Take the columns of W greedily, each the one farthest from the span of those taken.

    Examples
    --------
    >>> import loopid
    >>> W = loopid.regressors.structural_observation(loopid.load("four_bar"))
    >>> found = loopid.base_parameters.find_base(W, loopid.base_parameters.PivotedQR())
    >>> found.search.name, found.search.certified
    ('qr', False)
    """

    name: ClassVar[str] = "qr"

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        base = pivots(problem.structure.row_factor.T, problem.structure.rank)
        dependent = base_columns(problem.size, base)
        return self._result(problem, dependent, certified=False, evaluated=1)


@record(checked=True)
class KeptChoice(SearchStrategy):
    """Take the dependent parameters of another choice, by their labels: nothing is searched."""

    name: ClassVar[str] = "kept"

    dependent: tuple[str, ...] = ()

    def _search(self, problem: ChoiceProblem) -> SearchResult:
        labels = problem.structure.parameters.labels
        dependent = [j for j, label in enumerate(labels) if label in self.dependent]
        if len(dependent) != problem.dependent_count:
            raise OptionError(
                f"{problem.dependent_count} parameters are dependent, not the {len(dependent)} of "
                "the other choice",
                given=len(dependent),
                valid=problem.dependent_count,
            )
        return self._result(problem, dependent, certified=False, evaluated=1)


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


NO_COLUMNS = Readability(0, 0.0, ())


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
    """Readability of choices (c, d) of rows of a null basis, of columns (n,) or 0 ... n - 1."""
    names = choices if columns is None else columns[choices]
    size = max(1, BATCH // null_basis.size)
    for start in range(0, len(choices), size):
        part = slice(start, start + size)
        beta = np.abs(regrouping_matrix(null_basis, choices[part]))
        # Small coefficients are terms, but none that a choice among ties may hang on.
        counted = beta > TERM * np.maximum(beta.max(axis=(1, 2), initial=0.0), 1.0)[:, None, None]
        terms, totals = counted.sum(axis=(1, 2)).tolist(), beta.sum(axis=(1, 2)).tolist()
        for count, total, own in zip(terms, totals, names[part].tolist(), strict=True):
            yield Readability(count, total, tuple(sorted(own)))
