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
