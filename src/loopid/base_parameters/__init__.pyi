from .base import (
    SEARCHES as SEARCHES,
    BaseParameters as BaseParameters,
    expression as expression,
    find_base as find_base,
)
from .choice import (
    ChoiceProblem as ChoiceProblem,
    PivotedQR as PivotedQR,
    SearchOptions as SearchOptions,
    SearchResult as SearchResult,
    SearchStrategy as SearchStrategy,
)
from .exact import ExactSearch as ExactSearch
from .rank import RankTolerances as RankTolerances
from .structure import Structure as Structure
from .subgroups import SubgroupSearch as SubgroupSearch
