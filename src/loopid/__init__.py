"""Identification of the dynamics of robots with closed kinematic loops."""

from importlib.metadata import version

from loopid.base_parameters import (
    BaseParameters,
    ExactSearch,
    SubgroupSearch,
    find_base_parameters,
)
from loopid.consistency import consistent_fit, consistent_parameters
from loopid.dynamics import forward_dynamics
from loopid.errors import LoopidError
from loopid.experiment import (
    exciting_motion,
    find_force_model,
    identifiability,
    identify,
    split_recordings,
)
from loopid.export import export_regressor, export_robot_file
from loopid.identification import BayesianRidge, FitResult, FitSamples, eliminate, fit
from loopid.kinematics import (
    assemble,
    closed_motion,
    mobility,
    platform_coordinates,
    project,
    random_configurations,
)
from loopid.loading import bundled_robots, load_mechanism
from loopid.logs import prepare_recording, read_log
from loopid.parameters import ParameterSet
from loopid.prediction import predict
from loopid.regressors import (
    JointTerms,
    Observation,
    dynamic_regressor,
    force_parts,
    gravity_regressor,
    structural_observation,
    tree_regressor,
)
from loopid.robot import LoopClosure, Mechanism
from loopid.saved import read_fit, save_fit
from loopid.simulation import Noise, simulate_measurement
from loopid.trajectories import (
    FourierSeries,
    LowPass,
    Waypoint,
    joint_motion,
    point_to_point,
    read_motion_program,
    read_reference,
    review_motion,
)

__version__ = version("loopid")

# In the order of the work.
__all__ = [  # noqa: RUF022
    # A robot,
    "load_mechanism",
    "bundled_robots",
    "Mechanism",
    "LoopClosure",
    # where it can be,
    "assemble",
    "project",
    "closed_motion",
    "platform_coordinates",
    "mobility",
    "random_configurations",
    # what forces its motion takes,
    "tree_regressor",
    "gravity_regressor",
    "dynamic_regressor",
    "force_parts",
    "forward_dynamics",
    "JointTerms",
    # what can be known,
    "structural_observation",
    "Observation",
    "ParameterSet",
    "find_base_parameters",
    "BaseParameters",
    "ExactSearch",
    "SubgroupSearch",
    # how it moves,
    "read_motion_program",
    "read_reference",
    "point_to_point",
    "Waypoint",
    "FourierSeries",
    "joint_motion",
    "review_motion",
    "simulate_measurement",
    "Noise",
    # what was measured,
    "read_log",
    "prepare_recording",
    "LowPass",
    # the parameters' values,
    "find_force_model",
    "identify",
    "split_recordings",
    "identifiability",
    "exciting_motion",
    "fit",
    "FitSamples",
    "FitResult",
    "BayesianRidge",
    "eliminate",
    "consistent_fit",
    "consistent_parameters",
    # and files for others.
    "save_fit",
    "read_fit",
    "predict",
    "export_robot_file",
    "export_regressor",
    "LoopidError",
    "__version__",
]
