"""What the parameters are: fit problems, estimators, results with their uncertainty."""

from loopid.identification.least_squares import (
    Estimator,
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from loopid.identification.problem import FitProblem
from loopid.identification.result import FitResult, Quality

__all__ = [
    "Estimator",
    "FitProblem",
    "FitResult",
    "OrdinaryLeastSquares",
    "Quality",
    "WeightedLeastSquares",
]
