"""Physical consistency: standard parameters with positive definite pseudo-inertias."""

from loopid.consistency.fit import ConsistentFit, FitCost, consistent_fit, consistent_parameters
from loopid.consistency.prior import repaired_prior
from loopid.consistency.program import REGULARISATIONS
from loopid.pseudo_inertia import pseudo_inertia
