"""Identification of the dynamics of robots with closed kinematic loops."""

from importlib import import_module

# Public names in the order of the work, each with its room, which is imported when a name of it is
# asked for. ``__init__.pyi`` says the same to type checkers.
_ROOMS = {
    # A robot,
    "load_mechanism": "loading",
    "bundled_robots": "loading",
    "Mechanism": "robot",
    # where it can be,
    "assemble": "kinematics",
    "random_configurations": "kinematics",
    # what forces its motion takes,
    "gravity_regressor": "regressors",
    "dynamic_regressor": "regressors",
    "forward_dynamics": "simulation",
    "JointTerms": "regressors",
    # what can be known,
    "structural_observation": "regressors",
    "Observation": "observation",
    "ParameterSet": "parameters",
    "find_base_parameters": "base_parameters",
    "ExactSearch": "base_parameters",
    # how it moves,
    "read_motion_program": "trajectories",
    "FourierSeries": "trajectories",
    "joint_motion": "trajectories",
    "review_motion": "trajectories",
    "simulate_measurement": "simulation",
    "Noise": "simulation",
    # what was measured,
    "read_log": "logs",
    "prepare_recording": "logs",
    "LowPass": "trajectories",
    # the parameters' values,
    "find_force_model": "experiment",
    "identify": "experiment",
    "split_recordings": "experiment",
    "identifiability": "experiment",
    "design_excitation": "excitation",
    "MotionLimits": "excitation",
    "identify_payload": "experiment",
    "drive_gains": "experiment",
    "fit": "identification",
    "FitSamples": "identification",
    "BayesianRidge": "identification",
    "consistent_fit": "consistency",
    "consistent_parameters": "consistency",
    # and files for others.
    "save_fit": "saved",
    "read_fit": "saved",
    "predict": "prediction",
    "export_robot_file": "export",
    "export_regressor": "export",
    "LoopidError": "errors",
}
__all__ = [*_ROOMS, "__version__"]


def __getattr__(name: str) -> object:
    found: object
    if name == "__version__":
        found = import_module("importlib.metadata").version("loopid")
    elif name in _ROOMS:
        found = getattr(import_module(f"loopid.{_ROOMS[name]}"), name)
    elif name in _ROOMS.values():
        found = import_module(f"loopid.{name}")
    else:
        raise AttributeError(f"module 'loopid' has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return __all__
