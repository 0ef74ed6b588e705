"""What can be known: rank, independent blocks, regrouping and the searches for the best choice."""

from loopid.base_parameters.base import (
    STRATEGIES,
    BaseParameters,
    find_base_parameters,
    make_strategy,
)
from loopid.base_parameters.choice import (
    CRITERIA,
    TIE_TOLERANCE,
    ChoiceProblem,
    Exclusion,
    ExhaustiveSearch,
    SearchResult,
    SearchStrategy,
)
from loopid.base_parameters.exact import TIME_LIMIT, ExactSearch
from loopid.base_parameters.guess import PivotedQR
from loopid.base_parameters.naming import (
    CoefficientName,
    equations,
    expression,
    name_coefficients,
)
from loopid.base_parameters.structure import (
    Structure,
    analyse,
    independent_blocks,
    without_effect,
)
from loopid.base_parameters.subgroup import SubgroupSearch
