"""The public names, in the order of the work; subpackages hold the rest."""

from . import (
    base_parameters as base_parameters,
    control as control,
    diagnosis as diagnosis,
    errors as errors,
    excitation as excitation,
    export as export,
    findings as findings,
    identification as identification,
    kinematics as kinematics,
    loading as loading,
    logs as logs,
    motion as motion,
    observation as observation,
    paper as paper,
    parameters as parameters,
    plots as plots,
    progress as progress,
    regressors as regressors,
    report as report,
    robot as robot,
    view as view,
)
from .diagnosis import identify_payload as identify_payload
from .errors import LoopidError as LoopidError
from .excitation import (
    DesignOptions as DesignOptions,
    MotionLimits as MotionLimits,
    design_motion as design_motion,
)
from .identification import (
    Fit as Fit,
    FitOptions as FitOptions,
    find_base_parameters as find_base_parameters,
    force_model as force_model,
    identify as identify,
    load_fit as load_fit,
)
from .kinematics import random_configurations as random_configurations
from .loading import (
    Closure as Closure,
    bundled_robots as bundled_robots,
    from_pinocchio as from_pinocchio,
    load as load,
)
from .logs import (
    ExternalWrench as ExternalWrench,
    FilterOptions as FilterOptions,
    Log as Log,
    prepare as prepare,
    read_log as read_log,
)
from .motion import simulate as simulate
from .regressors import Dynamics as Dynamics, JointTerms as JointTerms
from .robot import Robot as Robot
