from .bayes import (
    BayesianRidge as BayesianRidge,
    Prior as Prior,
    evidence_scale as evidence_scale,
)
from .consistent import (
    ConsistentFit as ConsistentFit,
    FitCost as FitCost,
    consistent_fit as consistent_fit,
    consistent_parameters as consistent_parameters,
)
from .consistent_prior import (
    repaired_prior as repaired_prior,
)
from .consistent_program import (
    REGULARISATIONS as REGULARISATIONS,
)
from .fitting import (
    ESTIMATORS as ESTIMATORS,
    chosen_estimator as chosen_estimator,
    fit as fit,
    fit_in_steps as fit_in_steps,
    quiet_fit as quiet_fit,
    warn_of_insignificant as warn_of_insignificant,
    working_fit as working_fit,
)
from .force_model import (
    ForceModel as ForceModel,
    cad_prior as cad_prior,
    distributed_problem as distributed_problem,
    find_force_model as find_force_model,
    reference_instruments as reference_instruments,
)
from .information import (
    Excitation as Excitation,
    Identifiability as Identifiability,
    WeakDirection as WeakDirection,
    excited_samples as excited_samples,
    identifiability as identifiability,
)
from .instrumental import (
    InstrumentalVariables as InstrumentalVariables,
)
from .least_squares import (
    LEAST_EXCITATION as LEAST_EXCITATION,
    Estimator as Estimator,
    OrdinaryLeastSquares as OrdinaryLeastSquares,
    WeightedLeastSquares as WeightedLeastSquares,
    WorkingFit as WorkingFit,
    excited_rank as excited_rank,
)
from .pipeline import (
    DEFAULT_FRACTION as DEFAULT_FRACTION,
    UNIDENTIFIABLE as UNIDENTIFIABLE,
    Candidate as Candidate,
    Identification as Identification,
    identify as identify,
    prediction_error as prediction_error,
    prediction_reach as prediction_reach,
    split_recordings as split_recordings,
)
from .prediction import (
    Prediction as Prediction,
    predict as predict,
)
from .problem import (
    FitProblem as FitProblem,
    FitSamples as FitSamples,
)
from .result import (
    Estimate as Estimate,
    FitResult as FitResult,
    NoiseModel as NoiseModel,
    Quality as Quality,
    Robustness as Robustness,
    fit_quality as fit_quality,
)
from .robust import (
    Bisquare as Bisquare,
)
from .saved import (
    SavedFit as SavedFit,
    read_fit as read_fit,
    robot_files as robot_files,
    save_fit as save_fit,
)
