from .consistent import ConsistentOptions as ConsistentOptions, consistent_fit as consistent_fit
from .correlation import Autoregression as Autoregression
from .cutoff import CutoffChoice as CutoffChoice, choose_cutoff as choose_cutoff
from .delay import (
    Delay as Delay,
    find_delay as find_delay,
    with_delay_errors as with_delay_errors,
    without_delay as without_delay,
)
from .estimator import (
    ESTIMATORS as ESTIMATORS,
    Estimator as Estimator,
    OrdinaryLeastSquares as OrdinaryLeastSquares,
    WeightedLeastSquares as WeightedLeastSquares,
    WorkingFit as WorkingFit,
)
from .evidence import SuspicionOptions as SuspicionOptions
from .fitting import (
    fit as fit,
    fit_in_steps as fit_in_steps,
    quiet_fit as quiet_fit,
    working_fit as working_fit,
)
from .force_model import (
    ForceModel as ForceModel,
    distributed_problem as distributed_problem,
    find_force_model as find_force_model,
    reference_instruments as reference_instruments,
    samples_of as samples_of,
)
from .friction import (
    FrictionCurve as FrictionCurve,
    FrictionLine as FrictionLine,
    FrictionSummary as FrictionSummary,
    friction_curve as friction_curve,
    friction_summary as friction_summary,
    motor_use as motor_use,
    nearest_line as nearest_line,
    with_friction as with_friction,
)
from .hysteresis import HysteresisLoop as HysteresisLoop, hysteresis_loop as hysteresis_loop
from .identification import Identification as Identification, split_recordings as split_recordings
from .information import (
    Excitation as Excitation,
    Identifiability as Identifiability,
    WeakDirection as WeakDirection,
    body_sizes as body_sizes,
    fit_excited as fit_excited,
    identifiability as identifiability,
)
from .instrumental import InstrumentalVariables as InstrumentalVariables
from .log_mistakes import (
    MotorGain as MotorGain,
    Suspicions as Suspicions,
    suspicions as suspicions,
    suspicions_by_log as suspicions_by_log,
)
from .model_choice import ModelChoice as ModelChoice, choose_model as choose_model
from .options import FitOptions as FitOptions
from .pipeline import (
    fit_all as fit_all,
    fit_joint_terms as fit_joint_terms,
    fit_solid_bodies as fit_solid_bodies,
    identify as identify,
)
from .plausibility import absurdities as absurdities
from .prediction import (
    Candidate as Candidate,
    Prediction as Prediction,
    judge as judge,
    prediction_reach as prediction_reach,
)
from .problem import FitProblem as FitProblem, FitSamples as FitSamples
from .result import (
    Estimate as Estimate,
    FileDeviation as FileDeviation,
    Fit as Fit,
    MotorUse as MotorUse,
    NoiseModel as NoiseModel,
    Quality as Quality,
    Robustness as Robustness,
    TermDeviations as TermDeviations,
    fit_quality as fit_quality,
)
from .robust import Bisquare as Bisquare
from .saved import FitFile as FitFile, load_fit as load_fit
from .selection import (
    PredictionError as PredictionError,
    Reduction as Reduction,
    ReductionStep as ReductionStep,
    eliminate as eliminate,
    eliminate_parameters as eliminate_parameters,
    influence as influence,
    judge_essential as judge_essential,
    prediction_errors as prediction_errors,
    truncated_values as truncated_values,
)
from .term_sets import (
    TermComparison as TermComparison,
    TermSet as TermSet,
    compare_terms as compare_terms,
)
from .terms import TermOptions as TermOptions, choose_terms as choose_terms
