"""What the parameters are: fit problems, estimators, results with their uncertainty, selection."""

from loopid.identification.bayes import BayesianRidge, Prior, evidence_scale
from loopid.identification.fitting import (
    ESTIMATORS,
    chosen_estimator,
    fit,
    fit_in_steps,
    quiet_fit,
    warn_of_insignificant,
    working_fit,
)
from loopid.identification.instrumental import InstrumentalVariables
from loopid.identification.least_squares import (
    LEAST_EXCITATION,
    Estimator,
    OrdinaryLeastSquares,
    WeightedLeastSquares,
    WorkingFit,
    excited_rank,
)
from loopid.identification.problem import FitProblem, FitSamples
from loopid.identification.result import (
    Estimate,
    FitResult,
    NoiseModel,
    Quality,
    Robustness,
    fit_quality,
)
from loopid.identification.robust import Bisquare
from loopid.identification.selection import (
    PredictionError,
    Reduction,
    ReductionStep,
    eliminate,
    influence,
    prediction_errors,
    truncated_values,
)

__all__ = [
    "ESTIMATORS",
    "LEAST_EXCITATION",
    "BayesianRidge",
    "Bisquare",
    "Estimate",
    "Estimator",
    "FitProblem",
    "FitResult",
    "FitSamples",
    "InstrumentalVariables",
    "NoiseModel",
    "OrdinaryLeastSquares",
    "PredictionError",
    "Prior",
    "Quality",
    "Reduction",
    "ReductionStep",
    "Robustness",
    "WeightedLeastSquares",
    "WorkingFit",
    "chosen_estimator",
    "eliminate",
    "evidence_scale",
    "excited_rank",
    "fit",
    "fit_in_steps",
    "fit_quality",
    "influence",
    "prediction_errors",
    "quiet_fit",
    "truncated_values",
    "warn_of_insignificant",
    "working_fit",
]
