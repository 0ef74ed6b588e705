"""Search strategies behind one interface, one a file."""

from loopid.base_parameters.search.exact import TIME_LIMIT, ExactSearch
from loopid.base_parameters.search.exhaustive import ExhaustiveSearch
from loopid.base_parameters.search.problem import (
    CRITERIA,
    TIE_TOLERANCE,
    ChoiceProblem,
    Exclusion,
    SearchResult,
    SearchStrategy,
)
from loopid.base_parameters.search.qr import PivotedQR
from loopid.base_parameters.search.subgroup import SubgroupSearch
from loopid.errors import OptionError

STRATEGIES: dict[str, type[SearchStrategy]] = {
    strategy.name: strategy
    for strategy in (ExactSearch, SubgroupSearch, ExhaustiveSearch, PivotedQR)
}


def make_strategy(search: str | SearchStrategy) -> SearchStrategy:
    """A strategy with its default options, by name; a strategy comes back as it is."""
    if isinstance(search, SearchStrategy):
        return search
    if search not in STRATEGIES:
        raise OptionError.unknown("search", search, STRATEGIES)
    return STRATEGIES[search]()
