"""The public names, each with its room."""

from . import (
    base_parameters as base_parameters,
    control as control,
    diagnosis as diagnosis,
    errors as errors,
    excitation as excitation,
    export as export,
    identification as identification,
    kinematics as kinematics,
    loading as loading,
    logs as logs,
    motion as motion,
    paper as paper,
    plots as plots,
    regressors as regressors,
    report as report,
    robot as robot,
    view as view,
)
from .base_parameters import (
    ExactSearch as ExactSearch,
    RankTolerances as RankTolerances,
    SearchOptions as SearchOptions,
    find_base_parameters as find_base_parameters,
)
from .diagnosis import drive_gains as drive_gains, identify_payload as identify_payload
from .errors import LoopidError as LoopidError
from .excitation import (
    DesignOptions as DesignOptions,
    MotionLimits as MotionLimits,
    design_excitation as design_excitation,
)
from .export import to_pinocchio as to_pinocchio
from .findings import Finding as Finding
from .identification import (
    Fit as Fit,
    FitOptions as FitOptions,
    FitSamples as FitSamples,
    consistent_fit as consistent_fit,
    find_delay as find_delay,
    find_force_model as find_force_model,
    fit as fit,
    friction_curve as friction_curve,
    identifiability as identifiability,
    identify as identify,
    load_fit as load_fit,
    split_recordings as split_recordings,
)
from .kinematics import assemble as assemble, random_configurations as random_configurations
from .loading import (
    Closure as Closure,
    Coupling as Coupling,
    bundled_robots as bundled_robots,
    from_pinocchio as from_pinocchio,
    load_mechanism as load_mechanism,
)
from .logs import (
    ExternalWrench as ExternalWrench,
    FilterOptions as FilterOptions,
    Log as Log,
    MaskOptions as MaskOptions,
    prepare_recording as prepare_recording,
    read_log as read_log,
    wrench_forces as wrench_forces,
)
from .motion import (
    FourierSeries as FourierSeries,
    LowPass as LowPass,
    Noise as Noise,
    joint_motion as joint_motion,
    read_motion_program as read_motion_program,
    review_motion as review_motion,
    simulate_measurement as simulate_measurement,
)
from .observation import Observation as Observation
from .parameters import ParameterSet as ParameterSet
from .progress import progress_bar as progress_bar
from .regressors import (
    Dynamics as Dynamics,
    JointTerms as JointTerms,
    dynamic_regressor as dynamic_regressor,
    gravity_regressor as gravity_regressor,
    structural_observation as structural_observation,
)
from .robot import Mechanism as Mechanism
