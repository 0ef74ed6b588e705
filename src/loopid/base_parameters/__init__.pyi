from .base import (
    STRATEGIES as STRATEGIES,
    BaseParameters as BaseParameters,
    expression as expression,
    find_base_parameters as find_base_parameters,
    make_strategy as make_strategy,
)
from .choice import (
    CRITERIA as CRITERIA,
    TIE_TOLERANCE as TIE_TOLERANCE,
    ChoiceProblem as ChoiceProblem,
    Exclusion as Exclusion,
    ExhaustiveSearch as ExhaustiveSearch,
    SearchResult as SearchResult,
    SearchStrategy as SearchStrategy,
)
from .exact import (
    TIME_LIMIT as TIME_LIMIT,
    ExactSearch as ExactSearch,
)
from .guess import (
    PivotedQR as PivotedQR,
)
from .rank import (
    DoubtfulCombination as DoubtfulCombination,
    RankTolerances as RankTolerances,
    decide_rank as decide_rank,
    without_effect as without_effect,
)
from .structure import (
    Structure as Structure,
    analyse as analyse,
    independent_blocks as independent_blocks,
)
from .subgroup import (
    SubgroupSearch as SubgroupSearch,
)
