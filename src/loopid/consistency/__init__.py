"""Which bodies can exist: standard parameters with positive definite pseudo-inertias."""

from loopid.consistency.exact import consistent_parameters
from loopid.consistency.fitting import SOLVERS, consistent_fit
from loopid.consistency.prior import PriorDefect, prior_defects
from loopid.consistency.pseudo_inertia import pseudo_inertia
from loopid.consistency.regularisation import REGULARISATIONS
from loopid.consistency.repair import repaired_prior
from loopid.consistency.result import ConsistentFit, FitCost
from loopid.regions import Region

__all__ = [
    "REGULARISATIONS",
    "SOLVERS",
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
