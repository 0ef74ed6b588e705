from .base import (
    SEARCHES as SEARCHES,
    BaseParameter as BaseParameter,
    BaseParameters as BaseParameters,
    expression as expression,
    find_base_parameters as find_base_parameters,
    find_felt_parameters as find_felt_parameters,
)
from .choice import (
    CRITERIA as CRITERIA,
    ChoiceProblem as ChoiceProblem,
    Exclusion as Exclusion,
    PivotedQR as PivotedQR,
    SearchOptions as SearchOptions,
    SearchResult as SearchResult,
    SearchStrategy as SearchStrategy,
)
from .enumerated import ExhaustiveSearch as ExhaustiveSearch, SubgroupSearch as SubgroupSearch
from .exact import ExactSearch as ExactSearch
from .rank import DoubtfulCombination as DoubtfulCombination, RankTolerances as RankTolerances
from .structure import (
    Structure as Structure,
    analyse as analyse,
    independent_blocks as independent_blocks,
)
