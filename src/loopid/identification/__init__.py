"""What the parameters are: fit problems, estimators, results with their uncertainty."""

from loopid.identification.bayes import BayesianRidge
from loopid.identification.estimate import Estimate
from loopid.identification.estimator import Estimator, SampleEstimator, WorkingFit
from loopid.identification.fitting import ESTIMATORS, fit, quiet_fit, working_fit
from loopid.identification.instrumental import InstrumentalVariables
from loopid.identification.least_squares import OrdinaryLeastSquares, WeightedLeastSquares
from loopid.identification.noise import NoiseModel
from loopid.identification.prior import Prior
from loopid.identification.problem import FitProblem
from loopid.identification.quality import Quality, fit_quality
from loopid.identification.result import FitResult
from loopid.identification.robust import Bisquare, Huber
from loopid.identification.robustness import Robustness
from loopid.identification.samples import FitSamples
from loopid.identification.steps import fit_in_steps
from loopid.identification.total_least_squares import TotalLeastSquares

__all__ = [
    "ESTIMATORS",
    "BayesianRidge",
    "Bisquare",
    "Estimate",
    "Estimator",
    "FitProblem",
    "FitResult",
    "FitSamples",
    "Huber",
    "InstrumentalVariables",
    "NoiseModel",
    "OrdinaryLeastSquares",
    "Prior",
    "Quality",
    "Robustness",
    "SampleEstimator",
    "TotalLeastSquares",
    "WeightedLeastSquares",
    "WorkingFit",
    "fit",
    "fit_in_steps",
    "fit_quality",
    "quiet_fit",
    "working_fit",
]
