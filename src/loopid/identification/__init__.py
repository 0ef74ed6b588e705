"""What the parameters are: fit problems, estimators, results with their uncertainty."""

from loopid.identification.estimate import Estimate
from loopid.identification.fitting import ESTIMATORS, fit, quiet_fit
from loopid.identification.least_squares import (
    Estimator,
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from loopid.identification.noise import NoiseModel
from loopid.identification.problem import FitProblem
from loopid.identification.quality import Quality, fit_quality
from loopid.identification.result import FitResult
from loopid.identification.samples import FitSamples
from loopid.identification.steps import fit_in_steps

__all__ = [
    "ESTIMATORS",
    "Estimate",
    "Estimator",
    "FitProblem",
    "FitResult",
    "FitSamples",
    "NoiseModel",
    "OrdinaryLeastSquares",
    "Quality",
    "WeightedLeastSquares",
    "fit",
    "fit_in_steps",
    "fit_quality",
    "quiet_fit",
]
