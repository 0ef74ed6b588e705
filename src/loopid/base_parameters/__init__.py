"""What can be known: rank, independent blocks, regrouping and the searches for the best choice."""

from loopid.base_parameters.base import BaseParameters, find_base_parameters
from loopid.base_parameters.naming import (
    CoefficientName,
    equations,
    expression,
    name_coefficients,
)
from loopid.base_parameters.search import (
    CRITERIA,
    STRATEGIES,
    TIE_TOLERANCE,
    TIME_LIMIT,
    ChoiceProblem,
    ExactSearch,
    Exclusion,
    ExhaustiveSearch,
    PivotedQR,
    SearchResult,
    SearchStrategy,
    SubgroupSearch,
    make_strategy,
)
from loopid.base_parameters.structure import Structure, analyse, independent_blocks
