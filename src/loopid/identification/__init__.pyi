from .candidate import judge as judge
from .consistent import consistent_fit as consistent_fit
from .cutoff import choose_cutoff as choose_cutoff
from .delay import Delay as Delay, find_delay as find_delay
from .estimates import Estimate as Estimate
from .estimator import (
    ESTIMATORS as ESTIMATORS,
    Estimator as Estimator,
    OrdinaryLeastSquares as OrdinaryLeastSquares,
    WeightedLeastSquares as WeightedLeastSquares,
    WorkingFit as WorkingFit,
)
from .fitting import fit as fit, fit_in_steps as fit_in_steps
from .force_models import (
    ForceModel as ForceModel,
    find_base_parameters as find_base_parameters,
    force_model as force_model,
    samples_of as samples_of,
)
from .friction import with_friction as with_friction
from .friction_curves import friction_curve as friction_curve
from .identification import Identification as Identification, split_recordings as split_recordings
from .information import Excitation as Excitation, identifiability as identifiability
from .instrumental import InstrumentalVariables as InstrumentalVariables
from .log_mistakes import log_faults as log_faults
from .model_choice import choose_model as choose_model
from .options import FitOptions as FitOptions
from .pipeline import fit_all as fit_all, fit_joint_terms as fit_joint_terms, identify as identify
from .prediction import Prediction as Prediction
from .problem import FitProblem as FitProblem, FitSamples as FitSamples
from .result import Fit as Fit, load_fit as load_fit
from .robust import Bisquare as Bisquare
from .selection import Reduction as Reduction, eliminate as eliminate, influence as influence
from .terms import choose_terms as choose_terms
