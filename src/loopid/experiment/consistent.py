"""Bodies that can exist, fitted to the data of an identification."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from loopid.experiment.force_model import ForceModel
from loopid.identification import FitProblem, FitResult

if TYPE_CHECKING:
    from loopid.consistency import ConsistentFit


def fit_consistent(
    force_model: ForceModel,
    problem: FitProblem,
    fit: FitResult,
    regularisation: str = "entropic",
    repair: bool = False,
) -> ConsistentFit:
    """As ``consistent_fit``, near the bodies of the robot file.

    Parameters
    ----------
    problem : FitProblem
        The data that were fitted.
    fit : FitResult
        All parameters of the force model.
    """
    from loopid.consistency import consistent_fit  # here: only those who ask for it wait for it

    bodies = force_model.mechanism.standard_parameters(force_model.model)
    unknown = np.zeros(len(force_model.base.parameters) - len(bodies))
    prior = np.concatenate([bodies, unknown])
    return consistent_fit(
        problem, fit, force_model.base, prior, regularisation=regularisation, repair=repair
    )
