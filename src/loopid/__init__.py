"""Identification of the dynamics of robots with closed kinematic loops."""

from importlib.metadata import version

from loopid.base_parameters import (
    BaseParameters,
    ExactSearch,
    ExhaustiveSearch,
    PivotedQR,
    SearchResult,
    SubgroupSearch,
    find_base_parameters,
)
from loopid.dynamics import forward_dynamics
from loopid.errors import LoopidError
from loopid.experiment import (
    ForceModel,
    Identification,
    data_support,
    distributed_problem,
    find_force_model,
    identify,
    split_recordings,
)
from loopid.identification import (
    BayesianRidge,
    Bisquare,
    FitResult,
    FitSamples,
    Huber,
    InstrumentalVariables,
    TotalLeastSquares,
    fit,
)
from loopid.kinematics import (
    assemble,
    closed_motion,
    mobility,
    platform_coordinates,
    project,
    random_configurations,
    singularity_measure,
)
from loopid.loading import bundled_robots, load_mechanism
from loopid.logs import Log, Recording, prepare_recording, read_log
from loopid.parameters import Parameter, ParameterSet
from loopid.regressors import (
    ForceParts,
    JointTerms,
    Observation,
    dynamic_regressor,
    force_parts,
    gravity_regressor,
    structural_observation,
    tree_regressor,
)
from loopid.robot import LoopClosure, Mechanism
from loopid.simulation import Noise, simulate_measurement
from loopid.trajectories import (
    FourierSeries,
    JointMotion,
    LowPass,
    Motion,
    Waypoint,
    joint_motion,
    point_to_point,
    read_motion_program,
    read_reference,
    review_motion,
)

__version__ = version("loopid")

__all__ = [
    "BaseParameters",
    "BayesianRidge",
    "Bisquare",
    "ExactSearch",
    "ExhaustiveSearch",
    "FitResult",
    "FitSamples",
    "ForceModel",
    "ForceParts",
    "FourierSeries",
    "Huber",
    "Identification",
    "InstrumentalVariables",
    "JointMotion",
    "JointTerms",
    "Log",
    "LoopClosure",
    "LoopidError",
    "LowPass",
    "Mechanism",
    "Motion",
    "Noise",
    "Observation",
    "Parameter",
    "ParameterSet",
    "PivotedQR",
    "Recording",
    "SearchResult",
    "SubgroupSearch",
    "TotalLeastSquares",
    "Waypoint",
    "__version__",
    "assemble",
    "bundled_robots",
    "closed_motion",
    "data_support",
    "distributed_problem",
    "dynamic_regressor",
    "find_base_parameters",
    "find_force_model",
    "fit",
    "force_parts",
    "forward_dynamics",
    "gravity_regressor",
    "identify",
    "joint_motion",
    "load_mechanism",
    "mobility",
    "platform_coordinates",
    "point_to_point",
    "prepare_recording",
    "project",
    "random_configurations",
    "read_log",
    "read_motion_program",
    "read_reference",
    "review_motion",
    "simulate_measurement",
    "singularity_measure",
    "split_recordings",
    "structural_observation",
    "tree_regressor",
]
