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
from loopid.errors import LoopidError
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
from loopid.mechanism import LoopClosure, Mechanism
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

__version__ = version("loopid")

__all__ = [
    "BaseParameters",
    "ExactSearch",
    "ExhaustiveSearch",
    "ForceParts",
    "JointTerms",
    "LoopClosure",
    "LoopidError",
    "Mechanism",
    "Observation",
    "Parameter",
    "ParameterSet",
    "PivotedQR",
    "SearchResult",
    "SubgroupSearch",
    "__version__",
    "assemble",
    "bundled_robots",
    "closed_motion",
    "dynamic_regressor",
    "find_base_parameters",
    "force_parts",
    "gravity_regressor",
    "load_mechanism",
    "mobility",
    "platform_coordinates",
    "project",
    "random_configurations",
    "singularity_measure",
    "structural_observation",
    "tree_regressor",
]
