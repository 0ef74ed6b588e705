"""What can be known: rank, independent blocks, regrouping and the searches for the best choice."""

from loopid.base_parameters.base import BaseParameters, find_base_parameters
from loopid.base_parameters.blocks import independent_blocks
from loopid.base_parameters.coefficients import name_coefficients
from loopid.base_parameters.expressions import expression
from loopid.base_parameters.forms import CoefficientName
from loopid.base_parameters.search import (
    CRITERIA,
    STRATEGIES,
    ChoiceProblem,
    ExactSearch,
    ExhaustiveSearch,
    PivotedQR,
    SearchResult,
    SearchStrategy,
    SubgroupSearch,
)
from loopid.base_parameters.structure import Structure, analyse

__all__ = [
    "CRITERIA",
    "STRATEGIES",
    "BaseParameters",
    "ChoiceProblem",
    "CoefficientName",
    "ExactSearch",
    "ExhaustiveSearch",
    "PivotedQR",
    "SearchResult",
    "SearchStrategy",
    "Structure",
    "SubgroupSearch",
    "analyse",
    "expression",
    "find_base_parameters",
    "independent_blocks",
    "name_coefficients",
]
