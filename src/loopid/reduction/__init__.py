"""Which parameters matter: their influence, what leaving them out does, what data support."""

from loopid.reduction.elimination import eliminate
from loopid.reduction.influence import influence
from loopid.reduction.result import Reduction, ReductionStep
from loopid.reduction.truncation import truncated_values, truncation_bias

__all__ = [
    "Reduction",
    "ReductionStep",
    "eliminate",
    "influence",
    "truncated_values",
    "truncation_bias",
]
