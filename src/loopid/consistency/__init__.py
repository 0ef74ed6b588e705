"""Physical consistency: standard parameters with positive definite pseudo-inertias."""

from loopid.consistency.fit import ConsistentFit, FitCost, consistent_fit, consistent_parameters
from loopid.consistency.prior import PriorDefect, prior_defects, repaired_prior
from loopid.consistency.program import REGULARISATIONS
from loopid.consistency.region import Region
from loopid.pseudo_inertia import pseudo_inertia

__all__ = [
    "REGULARISATIONS",
    "ConsistentFit",
    "FitCost",
    "PriorDefect",
    "Region",
    "consistent_fit",
    "consistent_parameters",
    "prior_defects",
    "pseudo_inertia",
    "repaired_prior",
]
