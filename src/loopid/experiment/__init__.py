"""From recordings to parameters: the force model, its identification, what the data support."""

from loopid.experiment.candidate import Candidate, prediction_error, prediction_reach
from loopid.experiment.distributed import distributed_problem
from loopid.experiment.force_model import ForceModel, find_force_model
from loopid.experiment.identify import (
    DEFAULT_FRACTION,
    Identification,
    identify,
    split_recordings,
)

__all__ = [
    "DEFAULT_FRACTION",
    "Candidate",
    "ForceModel",
    "Identification",
    "distributed_problem",
    "find_force_model",
    "identify",
    "prediction_error",
    "prediction_reach",
    "split_recordings",
]
