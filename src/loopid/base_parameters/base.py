"""Base parameters: the combinations that forces determine, in the form that was chosen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from types import MappingProxyType

import numpy as np
from pydantic import PositiveInt

from loopid.arguments import FloatArray, IntArray, checked, finite, frozen, shaped
from loopid.base_parameters.choice import (
    UNCLEAR_RANK,
    ChoiceProblem,
    SearchOptions,
    SearchResult,
    SearchStrategy,
)
from loopid.base_parameters.rank import (
    DoubtfulCombination,
    RankTolerances,
    warn_of_doubts,
    without_effect,
)
from loopid.base_parameters.structure import Structure, analyse, base_columns, regrouping_matrix
from loopid.errors import DataError, OptionError
from loopid.observation import Observation
from loopid.parameters import ParameterSet, html_table
from loopid.records import Tabular, record
from loopid.registry import Registry

SEARCHES: Registry[type[SearchStrategy]] = Registry(
    "search",
    {
        "exact": "loopid.base_parameters.exact:ExactSearch",
        "subgroup": "loopid.base_parameters.subgroups:SubgroupSearch",
        "qr": "loopid.base_parameters.choice:PivotedQR",
    },
)
LISTED = 3  # base parameters that a ``repr`` names
KNOWN_DIGITS = 10  # of a coefficient: round-off is in those beyond
LEAST_TIME = 0.01  # s, for a search after one that used all there was


@record(checked="outside")
class BaseParameters(Tabular):
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
    >>> robot = loopid.load("3ups_rpu")
    >>> base = loopid.base_parameters.find_base(loopid.regressors.structural_observation(robot))
    >>> loopid.base_parameters.expression(base["platform.mx"])
    'platform.mx - 0.3 leg1_stem.m + 0.1928 leg2_stem.m'
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

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: str) -> dict[str, float]:
        """Labels and factors of the sum that a parameter leads, with factor 1."""
        OptionError.require("base parameter", name, self.names)
        labels, row = self.parameters.labels, self.regrouping[self.names.index(name)]
        folded = {labels[self.dependent[k]]: float(row[k]) for k in np.flatnonzero(row)}
        return {name: 1.0, **folded}

    def _table(self) -> dict[str, tuple[str, ...]]:
        return {"name": self.combinations.names, "expression": self.expressions}

    def __repr__(self) -> str:
        return (
            f"BaseParameters({len(self)} of {len(self.parameters)} parameters, "
            f"{len(self.dependent)} dependent, rank gap {self.structure.rank_gap:.1e})\n"
            f"  {self.search!r}\n  {', '.join(self.combinations.names[:LISTED])}"
            f"{', ...' if len(self) > LISTED else ''}"
        )

    def _repr_html_(self) -> str:
        return html_table(("", "base parameter"), enumerate(self.expressions, 1))

    @property
    def doubtful(self) -> tuple[DoubtfulCombination, ...]:
        """Combinations that may have an effect or not; they do not count."""
        return self.structure.doubtful

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Label of the standard parameter that leads each base parameter, factor 1."""
        return self.parameters.select(self.base).labels

    @cached_property
    def combinations(self) -> ParameterSet:
        """The base parameters as parameters of a fit, each with its sum."""
        found = []
        for leading, terms in zip(self.parameters.select(self.base), self.terms, strict=True):
            _, *others = terms
            found.append(replace(leading, others=tuple(others), expression=expression(terms)))
        return ParameterSet(tuple(found))

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
        return tuple(MappingProxyType(self[name]) for name in self.names)

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
        phi = shaped(standard_parameters, "standard parameters", len(self.parameters))
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


@checked
def find_base(
    observation: Observation,
    search: str | SearchStrategy = "exact",
    *,
    criterion: str = "nullspace",
    tolerances: RankTolerances = RankTolerances(),
    options: SearchOptions | None = None,
) -> BaseParameters:
    """Find the base parameters of an observation and the best way of writing them.

    Parameters
    ----------
    observation : Observation
    search : str or SearchStrategy
        ``"exact"``, ``"subgroup"``, ``"qr"`` or another of ``SEARCHES``, or a
        strategy with options.
    criterion : str
        ``"nullspace"`` for the least cond(V22), ``"regressor"`` for the least cond(W_B).
    tolerances : RankTolerances
    options : SearchOptions, optional
        Instead of the search's own.

    Returns
    -------
    BaseParameters
        The choice of columns, its matrices, and how it was searched.

    Raises
    ------
    RankError
        When no parameter has an effect, or when there are too few rows.
    OptionError
        When the search is refused or finds nothing.

    Warns
    -----
    AccuracyWarning
        When combinations are doubtful: they do not count; and when the rank is unclear: no choice
        is certified.

    Examples
    --------
    >>> import loopid
    >>> observation = loopid.regressors.structural_observation(loopid.load("3ups_rpu"))
    >>> base = loopid.base_parameters.find_base(observation)
    >>> len(base), base.search.certified, round(base.nullspace_condition_number, 4)
    (15, True, 2.237)
    """
    strategy = SEARCHES[search]() if isinstance(search, str) else search
    strategy = strategy if options is None else replace(strategy, options=options)
    structure = analyse(observation, tolerances)
    warn_of_doubts(structure.doubtful, structure.rank_bounds)
    # Of equally good choices the first is taken, in an order that does not depend on the file's.
    ranks = {name: rank for rank, name in enumerate(observation.order)}
    places = [ranks.get(p.link, len(ranks)) for p in structure.parameters]
    order = np.argsort(places, kind="stable")
    result = strategy.search(ChoiceProblem(structure.permuted(order), criterion))
    if result.dependent is None:
        raise OptionError(
            f"{result.name} search found no valid choice among {result.evaluated:,} of "
            f"{result.candidates:,} combinations: use search='exact', or another order of columns",
            search=result.name,
            evaluated=result.evaluated,
        )
    dependent = np.sort(order[list(result.dependent)])
    account = result.subgroups and result.subgroups.renumbered(order.tolist())
    result = replace(result, dependent=tuple(dependent.tolist()), subgroups=account)
    if structure.rank_bounds:  # of another rank the choice would be another
        result = replace(result, certified=False, reason=UNCLEAR_RANK)
    return base_of_choice(observation.parameters, structure, result)


def base_of_choice(
    parameters: ParameterSet, structure: Structure, search: SearchResult
) -> BaseParameters:
    """Base parameters of a search's choice among the columns of a structure."""
    dependent = np.array(search.dependent, dtype=np.int64)
    base = base_columns(len(structure.columns), dependent)
    return BaseParameters(
        parameters=parameters,
        structure=structure,
        base=structure.columns[base],
        dependent=structure.columns[dependent],
        regrouping=regrouping_matrix(structure.null_basis, dependent, structure.zero),
        search=search,
    )


@checked
def find_base_and_motors_alone(
    observation: Observation,
    search: str | SearchStrategy = "exact",
    *,
    criterion: str = "nullspace",
    options: SearchOptions | None = None,
) -> tuple[BaseParameters, BaseParameters | None]:
    """Find the base parameters, and those that the motors alone sense, within one time limit.

    As ``find_base``; the second search has the time that the first one left. The first ones are of
    all rows: forces of the motors, and "= 0" of coordinates that they leave free. The others are
    None without free coordinates, or where the motors sense nothing.
    """
    find = partial(find_base, criterion=criterion)
    base, alone = find(observation, search, options=options), observation.motors_alone
    if alone is None or without_effect(alone):
        return base, None
    left = max(base.search.options.time_limit - base.search.seconds, LEAST_TIME)
    rest = replace(base.search.options, time_limit=left)
    return base, find(alone, search, options=rest)


@checked
def expression(terms: Mapping[str, float], digits: PositiveInt = 4) -> str:
    """Write terms as a sum, ``platform.mx + 0.1928 leg2_stem.m``.

    Parameters
    ----------
    terms : mapping
        Parameter label to coefficient.
    digits : int
        Significant digits of the coefficients, for reading only.

    Returns
    -------
    str
        The sum; a coefficient of one is not written.

    Raises
    ------
    OptionError
        When there are no digits.

    Examples
    --------
    >>> import loopid
    >>> loopid.base_parameters.expression({"platform.mx": 1.0, "leg2_stem.m": 0.19284})
    'platform.mx + 0.1928 leg2_stem.m'
    """
    text, known = "", max(digits, KNOWN_DIGITS)
    for label, coefficient in terms.items():
        # First to what is known of it: a tie is then the same on every processor.
        size = f"{float(f'{abs(coefficient):.{known}g}'):.{digits}g}"
        sign = "-" if coefficient < 0 else "+"
        joint = f" {sign} " if text else sign.strip("+")
        text += f"{joint}{'' if size == '1' else size + ' '}{label}"
    return text
