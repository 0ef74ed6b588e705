"""Public functions with sound arguments; the sweeps make wrong ones from them."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from api_world import World

ROOMS = (
    "loopid", "loopid.base_parameters", "loopid.consistency", "loopid.experiment", "loopid.export",
    "loopid.identification", "loopid.kinematics", "loopid.loading", "loopid.logs",
    "loopid.robot", "loopid.paper", "loopid.reduction", "loopid.regressors",
    "loopid.trajectories",
)  # fmt: skip
# What only the package makes, and tells in fields.
RECORDS = (
    "Assembly", "BaseParameters", "BaseValues", "Body", "Candidate", "ClosedMotion",
    "CoefficientName", "CompiledRegressor", "ConsistentFit", "Dropped", "Estimate",
    "Estimator", "Excitation", "ExcitingMotion", "Factorisation", "FitCost", "FitResult", "ForceModel", "ForceParts",
    "Identifiability", "Identification", "InertiaDefect", "JointCoupling", "JointRange", "LinkGroup",
    "LogMapping", "LoopClosure", "LoopidError", "Mechanism", "Mobility", "MotionProgram",
    "MotionReview", "NoiseModel", "OrdinaryLeastSquares", "PaperReproduction", "PivotedQR",
    "PlannedMotion", "Platform", "PriorDefect", "Projection", "Quality", "Recording", "Reduction",
    "ReductionStep", "RegressorCode", "Robustness", "SampleEstimator", "SavedFit", "SearchResult",
    "SearchStrategy", "SecondReading", "SimulatedFit", "Structure", "WeakDirection", "WeightedLeastSquares",
    "WorkingFit",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A public function and how to call it.

    Attributes
    ----------
    name : str
    function : callable
    sound : callable
        From the world to good arguments.
    free : frozenset of str
        Arguments that may be anything of their type, such as names.
    fine : frozenset of (str, str)
        Arguments, and what would be wrong elsewhere but has a good answer here.
    wrong : mapping
        From arguments to further values that are wrong.
    """

    name: str
    function: Callable[..., Any]
    sound: Callable[[World], dict[str, Any]]
    free: frozenset[str]
    fine: frozenset[tuple[str, str]]
    wrong: Mapping[str, Sequence[Any]]

    @property
    def kinds(self) -> dict[str, str]:
        """Annotation of each argument, as it is written."""
        found = inspect.signature(self.function).parameters.values()
        return {p.name: str(p.annotation).strip("'") for p in found}


CASES: dict[str, Case] = {}


def case(function, sound, label="", free=(), fine=(), **wrong) -> None:
    """Register a function, or a method as ``Class.method``."""
    name = label or function.__name__
    CASES[name] = Case(name, function, sound, frozenset(free), frozenset(fine), wrong)


def public_functions() -> dict[str, Any]:
    """All functions and classes that the rooms offer, by name."""
    found = {}
    for room in ROOMS:
        module = import_module(room)
        for name in module.__all__:
            if callable(getattr(module, name)):
                found.setdefault(name, getattr(module, name))
    return found
