"""Base parameters: the combinations that forces determine, in the form that was chosen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from types import MappingProxyType

import numpy as np

from loopid.arguments import (
    FloatArray,
    IntArray,
    checked,
    finite,
    frozen,
)
from loopid.base_parameters.choice import (
    ChoiceProblem,
    ExhaustiveSearch,
    SearchResult,
    SearchStrategy,
)
from loopid.base_parameters.exact import ExactSearch
from loopid.base_parameters.guess import PivotedQR
from loopid.base_parameters.rank import (
    DoubtfulCombination,
    warn_of_doubts,
)
from loopid.base_parameters.structure import (
    Structure,
    analyse,
    base_columns,
    regrouping_matrix,
)
from loopid.base_parameters.subgroup import SubgroupSearch
from loopid.errors import (
    DataError,
    OptionError,
    SearchError,
)
from loopid.observation import Observation
from loopid.parameters import ParameterSet

STRATEGIES: dict[str, type[SearchStrategy]] = {
    strategy.name: strategy
    for strategy in (ExactSearch, SubgroupSearch, ExhaustiveSearch, PivotedQR)
}


@dataclass(frozen=True, repr=False)
class BaseParameters:
    """A minimal set of parameters that reproduces every force, W_B Φ_base = W Φ [Gautier1991].

    Attributes
    ----------
    parameters : ParameterSet
        All the standard parameters Φ.
    structure : Structure
        Columns with an effect, rank and null space.
    base, dependent : IntArray
        (r,) and (d,), columns among all the standard parameters.
    regrouping : FloatArray
        (r, d), β of Φ_base = Φ_B + β Φ_D.
    search : SearchResult
        How the choice was made, and whether it is certified.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("four_bar")
    >>> base = loopid.find_base_parameters(loopid.structural_observation(robot))
    >>> base.matrix.shape == (len(base), len(base.parameters))
    True
    """

    parameters: ParameterSet
    structure: Structure
    base: IntArray
    dependent: IntArray
    regrouping: FloatArray
    search: SearchResult

    def __len__(self) -> int:
        return len(self.base)

    def __repr__(self) -> str:
        return (
            f"BaseParameters({len(self)} of {len(self.parameters)} parameters, "
            f"{len(self.dependent)} dependent, rank gap {self.structure.rank_gap:.1e})\n"
            f"  {self.search!r}\n  {', '.join(self.names[:6])}{', ...' if len(self) > 6 else ''}"
        )

    def _repr_html_(self) -> str:
        rows = (
            f"<tr><td>{i}</td><td>{escape(x)}</td></tr>" for i, x in enumerate(self.expressions, 1)
        )
        return f"<table><tr><th></th><th>base parameter</th></tr>{''.join(rows)}</table>"

    @property
    def doubtful(self) -> tuple[DoubtfulCombination, ...]:
        """Combinations that may have an effect or not; they do not count."""
        return self.structure.doubtful

    @property
    def names(self) -> tuple[str, ...]:
        """Label of the standard parameter that leads each base parameter, coefficient 1."""
        return self.parameters.select(self.base).labels

    @cached_property
    def matrix(self) -> FloatArray:
        """M (r, p) of Φ_base = M Φ, read-only."""
        M = np.zeros((len(self.base), len(self.parameters)))
        M[np.arange(len(self.base)), self.base] = 1.0
        M[:, self.dependent] = self.regrouping
        return frozen(M)

    @property
    def terms(self) -> tuple[Mapping[str, float], ...]:
        """For each base parameter its terms, read-only: the leading label, then those folded in."""
        labels = self.parameters.labels
        return tuple(
            MappingProxyType(
                {labels[leader]: 1.0} | {labels[j]: float(row[j]) for j in np.flatnonzero(row)}
            )
            for leader, row in zip(self.base, self.matrix, strict=True)
        )

    @property
    def expressions(self) -> tuple[str, ...]:
        """Each base parameter as a readable sum."""
        return tuple(expression(terms) for terms in self.terms)

    @property
    def condition_number(self) -> float:
        """cond(W_B): how much the regressor amplifies relative noise."""
        return self._criterion("regressor")

    @property
    def nullspace_condition_number(self) -> float:
        """cond(V22): how much the regrouping amplifies round-off."""
        return self._criterion("nullspace")

    def _criterion(self, criterion: str) -> float:
        dependent = np.searchsorted(self.structure.columns, self.dependent)
        return ChoiceProblem(self.structure, criterion).condition_number(dependent)

    def values(self, standard_parameters: FloatArray) -> FloatArray:
        """Base parameters (r,) of standard ones (p,)."""
        phi = finite(standard_parameters, "standard parameters")
        if phi.shape != (len(self.parameters),):
            raise DataError(
                f"standard parameters must have shape ({len(self.parameters)},), not {phi.shape}"
            )
        return np.asarray(self.matrix @ phi, dtype=np.float64)

    def regressor(self, matrix: FloatArray) -> FloatArray:
        """Columns W_B (..., r) of a regressor of all the standard parameters (..., p)."""
        W = finite(matrix, "regressor")
        if W.ndim == 0 or W.shape[-1] != len(self.parameters):
            raise DataError(f"regressor must have {len(self.parameters)} columns, not {W.shape}")
        return np.asarray(W[..., self.base], dtype=np.float64)

    def reconstruction_error(self, matrix: FloatArray) -> float:
        """Check on a regressor, best on fresh poses, that nothing was lost.

        Parameters
        ----------
        matrix : FloatArray
            W (..., p).

        Returns
        -------
        float
            ‖W - W_B M‖_F / ‖W‖_F; round-off when the base parameters hold for W.
        """
        rebuilt = self.regressor(matrix) @ self.matrix
        size = float(np.linalg.norm(matrix))
        return float(np.linalg.norm(rebuilt - matrix)) / size if size else 0.0


def make_strategy(search: str | SearchStrategy) -> SearchStrategy:
    """A strategy with its default options, by name; a strategy comes back as it is."""
    if isinstance(search, SearchStrategy):
        return search
    if search not in STRATEGIES:
        raise OptionError.unknown("search", search, STRATEGIES)
    return STRATEGIES[search]()


def find_base_parameters(
    observation: Observation,
    search: str | SearchStrategy = "exact",
    criterion: str = "nullspace",
) -> BaseParameters:
    """Find the base parameters of an observation and the best way of writing them.

    Parameters
    ----------
    observation : Observation
    search : str or SearchStrategy
        ``"exact"``, ``"subgroup"``, ``"exhaustive"``, ``"qr"``, or a strategy with options.
    criterion : str
        ``"nullspace"`` for the least cond(V22), ``"regressor"`` for the least cond(W_B).

    Raises
    ------
    RankError
        When the rank is ambiguous.
    SearchError
        When the search is refused or finds nothing.
    OptionError

    Examples
    --------
    >>> import loopid
    >>> observation = loopid.structural_observation(loopid.load_mechanism("3ups_rpu"))
    >>> base = loopid.find_base_parameters(observation)
    >>> len(base), base.search.certified, round(base.nullspace_condition_number, 4)
    (15, True, 2.237)
    """
    strategy = make_strategy(search)
    structure = analyse(observation)
    warn_of_doubts(structure.doubtful)
    # Of equally good choices the first is taken, in an order that does not depend on the file's.
    ranks = {name: rank for rank, name in enumerate(observation.order)}
    places = [ranks.get(p.link, len(ranks)) for p in structure.parameters]
    order = np.argsort(places, kind="stable")
    result = strategy.search(ChoiceProblem(structure.permuted(order), criterion))
    if result.dependent is None:
        raise SearchError(
            f"{result.name} search found no valid choice among {result.evaluated:,} of "
            f"{result.candidates:,} combinations: use search='exact', or another order of columns"
        )
    dependent = np.sort(order[list(result.dependent)])
    result = replace(result, dependent=tuple(dependent.tolist()))
    base = base_columns(len(structure.columns), dependent)
    return BaseParameters(
        parameters=observation.parameters,
        structure=structure,
        base=frozen(structure.columns[base], np.int64),
        dependent=frozen(structure.columns[dependent], np.int64),
        regrouping=frozen(regrouping_matrix(structure.null_basis, dependent, structure.precision)),
        search=result,
    )


@checked
def expression(terms: Mapping[str, float], digits: int = 4) -> str:
    """Write terms as a sum, ``platform.mx + 0.1928 leg2_stem.m``.

    Parameters
    ----------
    terms : mapping
        Parameter label to coefficient.
    digits : int
        Significant digits of the coefficients, for reading only.

    Raises
    ------
    OptionError
        When there are no digits.
    """
    if digits < 1:
        raise OptionError(f"digits must be a whole number from 1 on, not {digits}", given=digits)
    text = ""
    for label, coefficient in terms.items():
        size, sign = f"{abs(coefficient):.{digits}g}", "-" if coefficient < 0 else "+"
        joint = f" {sign} " if text else sign.strip("+")
        text += f"{joint}{'' if size == '1' else size + ' '}{label}"
    return text
