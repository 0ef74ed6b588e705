from .bayes import (
    BayesianRidge as BayesianRidge,
    Prior as Prior,
    body_sizes as body_sizes,
    cad_prior as cad_prior,
    evidence_scale as evidence_scale,
)
from .consistent import (
    ConsistentFit as ConsistentFit,
    FitCost as FitCost,
    consistent_fit as consistent_fit,
    consistent_parameters as consistent_parameters,
)
from .consistent_program import REGULARISATIONS as REGULARISATIONS, repaired_prior as repaired_prior
from .correlation import Autoregression as Autoregression, CorrelationOptions as CorrelationOptions
from .estimator import (
    ESTIMATORS as ESTIMATORS,
    LEAST_EXCITATION as LEAST_EXCITATION,
    Convergence as Convergence,
    Estimator as Estimator,
    OrdinaryLeastSquares as OrdinaryLeastSquares,
    WeightedLeastSquares as WeightedLeastSquares,
    WorkingFit as WorkingFit,
    chosen_estimator as chosen_estimator,
    excited_rank as excited_rank,
)
from .fitting import (
    fit as fit,
    fit_in_steps as fit_in_steps,
    quiet_fit as quiet_fit,
    warn_of_insignificant as warn_of_insignificant,
    working_fit as working_fit,
)
from .force_model import (
    ForceModel as ForceModel,
    distributed_problem as distributed_problem,
    find_force_model as find_force_model,
    reference_instruments as reference_instruments,
    samples_of as samples_of,
)
from .information import (
    Excitation as Excitation,
    Identifiability as Identifiability,
    WeakDirection as WeakDirection,
    excited_samples as excited_samples,
    fit_excited as fit_excited,
    identifiability as identifiability,
)
from .instrumental import InstrumentalVariables as InstrumentalVariables
from .pipeline import (
    UNIDENTIFIABLE as UNIDENTIFIABLE,
    FitOptions as FitOptions,
    Identification as Identification,
    fit_all as fit_all,
    fit_joint_terms as fit_joint_terms,
    identify as identify,
    likely_deviation as likely_deviation,
    split_recordings as split_recordings,
)
from .prediction import (
    Candidate as Candidate,
    Prediction as Prediction,
    judge as judge,
    predict as predict,
    prediction_error as prediction_error,
    prediction_reach as prediction_reach,
)
from .problem import FitProblem as FitProblem, FitSamples as FitSamples
from .result import (
    Estimate as Estimate,
    FitResult as FitResult,
    NoiseModel as NoiseModel,
    Quality as Quality,
    Robustness as Robustness,
    fit_quality as fit_quality,
)
from .robust import Bisquare as Bisquare
from .saved import (
    SavedFit as SavedFit,
    read_fit as read_fit,
    robot_files as robot_files,
    save_fit as save_fit,
)
