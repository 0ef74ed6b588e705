from .autoregression import (
    Autoregression as Autoregression,
    CorrelationOptions as CorrelationOptions,
)
from .bayes import BayesianRidge as BayesianRidge, Prior as Prior, evidence_scale as evidence_scale
from .candidate import (
    Candidate as Candidate,
    judge as judge,
    prediction_error as prediction_error,
    prediction_reach as prediction_reach,
)
from .consistent import (
    ConsistentFit as ConsistentFit,
    FitCost as FitCost,
    consistent_fit as consistent_fit,
    consistent_parameters as consistent_parameters,
)
from .consistent_prior import repaired_prior as repaired_prior
from .consistent_program import REGULARISATIONS as REGULARISATIONS
from .directions import (
    Excitation as Excitation,
    excited_samples as excited_samples,
    fit_excited as fit_excited,
)
from .distributed import distributed_problem as distributed_problem
from .estimator import (
    ESTIMATORS as ESTIMATORS,
    Estimator as Estimator,
    WorkingFit as WorkingFit,
    chosen_estimator as chosen_estimator,
)
from .fitting import (
    fit as fit,
    fit_in_steps as fit_in_steps,
    quiet_fit as quiet_fit,
    warn_of_insignificant as warn_of_insignificant,
    working_fit as working_fit,
)
from .force_model import ForceModel as ForceModel, find_force_model as find_force_model
from .information import (
    Identifiability as Identifiability,
    WeakDirection as WeakDirection,
    identifiability as identifiability,
)
from .instrumental import InstrumentalVariables as InstrumentalVariables
from .least_squares import (
    LEAST_EXCITATION as LEAST_EXCITATION,
    Convergence as Convergence,
    excited_rank as excited_rank,
)
from .options import UNIDENTIFIABLE as UNIDENTIFIABLE, FitOptions as FitOptions
from .ordinary import OrdinaryLeastSquares as OrdinaryLeastSquares
from .pipeline import (
    Identification as Identification,
    fit_all as fit_all,
    fit_joint_terms as fit_joint_terms,
    identify as identify,
    likely_deviation as likely_deviation,
)
from .prediction import Prediction as Prediction, predict as predict
from .problem import FitProblem as FitProblem, FitSamples as FitSamples
from .result import (
    Estimate as Estimate,
    FitResult as FitResult,
    NoiseModel as NoiseModel,
    Quality as Quality,
    Robustness as Robustness,
    fit_quality as fit_quality,
)
from .robot_prior import body_sizes as body_sizes, cad_prior as cad_prior
from .robust import Bisquare as Bisquare
from .samples import (
    reference_instruments as reference_instruments,
    samples_of as samples_of,
    split_recordings as split_recordings,
)
from .saved import (
    SavedFit as SavedFit,
    read_fit as read_fit,
    robot_files as robot_files,
    save_fit as save_fit,
)
from .weighted import WeightedLeastSquares as WeightedLeastSquares
