"""Bodies that can exist, fitted to the data of an identification."""

from __future__ import annotations

from typing import TYPE_CHECKING

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

    base, prior = force_model.base, force_model.standard_prior
    return consistent_fit(problem, fit, base, prior, regularisation=regularisation, repair=repair)
