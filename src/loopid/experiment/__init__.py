"""From recordings to parameters: the force model, its identification, what the data support."""

from loopid.experiment.cad_prior import cad_prior
from loopid.experiment.candidate import Candidate, prediction_error, prediction_reach
from loopid.experiment.distributed import distributed_problem
from loopid.experiment.force_model import ForceModel, find_force_model
from loopid.experiment.identifiability import DataSupport, data_support
from loopid.experiment.identification import (
    DEFAULT_FRACTION,
    Identification,
    split_recordings,
)
from loopid.experiment.identify import ON_DARK, identify
from loopid.experiment.lighting import Lighting
from loopid.experiment.lighting_motion import lighting_motion
from loopid.experiment.weak_directions import WeakDirection

__all__ = [
    "DEFAULT_FRACTION",
    "ON_DARK",
    "Candidate",
    "DataSupport",
    "ForceModel",
    "Identification",
    "Lighting",
    "WeakDirection",
    "cad_prior",
    "data_support",
    "distributed_problem",
    "find_force_model",
    "identify",
    "lighting_motion",
    "prediction_error",
    "prediction_reach",
    "split_recordings",
]
