"""Motions, filters, names and searches: what is made of plain values."""

import numpy as np
from case_registry import case
from robot_cases import BAD

import loopid
from loopid import base_parameters, paper, trajectories

NAMED = ("names", "joints", "coordinate", "link", "kind", "unit")

case(
    loopid.Noise,
    lambda w: {"uniform": 1.0, "gaussian": 1.0, "encoder_step": 1e-6},
    uniform=BAD,
    gaussian=BAD,
)
case(
    loopid.JointTerms,
    lambda w: {"joints": w.robot.actuated, "kinds": ("Fc",), "dead_zone": 0.1, "smoothing": 0.1},
    free=NAMED,
    dead_zone=BAD,
)
case(loopid.LowPass, lambda w: {"cutoff": 2.0, "order": 2}, cutoff=(0, *BAD), order=(0,))
case(
    loopid.LowPass(2.0).apply,
    lambda w: {"values": np.sin(w.arm_motion.time), "rate": 50.0},
    "LowPass.apply",
    fine=[("values", "one column more")],
    rate=(0, *BAD),
)
case(
    trajectories.differentiate,
    lambda w: {"values": np.sin(w.arm_motion.time), "rate": 50.0},
    fine=[("values", "one column more")],
    rate=(0, *BAD),
)
case(
    loopid.FourierSeries,
    lambda w: {
        "names": ("a", "b"),
        "frequency": 1.0,
        "offset": np.zeros(2),
        "sine": np.ones((2, 3)),
        "cosine": np.ones((2, 3)),
    },
    free=NAMED,
    frequency=(0, *BAD),
)
case(
    loopid.FourierSeries(("a",), 1.0, np.zeros(1), np.ones((1, 1)), np.ones((1, 1))).motion,
    lambda w: {"duration": 2.0, "rate": 50.0},
    "FourierSeries.motion",
    duration=(0, *BAD, 1e12),
    rate=(0, *BAD, 1e12),
)


def fields(thing, names):
    return {name: np.array(getattr(thing, name)) for name in names}


case(
    loopid.Motion,
    lambda w: {
        "names": w.platform_motion.names,
        **fields(w.platform_motion, ("time", "position", "velocity", "acceleration")),
    },
    free=NAMED,
)
MOVING = ("configurations", "velocities", "accelerations")
case(
    loopid.JointMotion,
    lambda w: fields(w.motion, ("time", *MOVING, "singularity")),
    fine=[(name, "one column more") for name in MOVING],
)
case(
    trajectories.Arc,
    lambda w: {"coordinate": "a", "height": 0.1, "flatness": 0.5},
    free=NAMED,
    flatness=(1, *BAD),
)
case(
    loopid.Waypoint,
    lambda w: {"position": np.ones(2), "seconds": 1.0},
    fine=[("position", "one column more")],
)
case(
    loopid.point_to_point,
    lambda w: {
        "names": ("a", "b"),
        "start": np.zeros(2),
        "waypoints": [loopid.Waypoint(np.ones(2), 1.0)],
        "rate": 50.0,
    },
    free=NAMED,
    waypoints=([], [loopid.Waypoint(np.ones(2), 0.0)], [loopid.Waypoint(np.ones(3), 1.0)]),
    rate=(0, *BAD, 1e12),
)
case(
    loopid.read_reference,
    lambda w: {
        "path": w.reference_file,
        "names": ("a", "b"),
        "rate": 50.0,
        "lowpass": loopid.LowPass(2.0),
    },
    rate=(0, *BAD),
)
case(loopid.read_motion_program, lambda w: {"path": "3ups_rpu"})
case(
    loopid.Parameter, lambda w: {"link": "a", "kind": "m", "unit": "kg"}, free=NAMED, link=(3, None)
)
case(loopid.ParameterSet, lambda w: {"parameters": tuple(w.samples.parameters)})
case(
    loopid.Observation.from_matrix,
    lambda w: {
        "matrix": np.array(w.observation.matrix),
        "parameters": w.observation.parameters,
        "length": 1.0,
        "natural_size": 0.0,
    },
    "Observation.from_matrix",
    fine=[("matrix", "one axis more")],
    length=(0, *BAD),
)
case(
    loopid.find_base_parameters,
    lambda w: {"observation": w.observation, "search": "qr", "criterion": "nullspace"},
)
case(base_parameters.analyse, lambda w: {"observation": w.observation})
case(
    base_parameters.independent_blocks,
    lambda w: {"null_basis": np.array(w.base.structure.null_basis)},
    fine=[("null_basis", "one column more")],
)
case(
    base_parameters.expression,
    lambda w: {"terms": w.base.terms[0], "digits": 4, "names": {}},
    digits=(0,),
)
case(base_parameters.name_coefficients, lambda w: {"base": w.base, "lengths": w.lengths})
case(
    base_parameters.ChoiceProblem,
    lambda w: {"structure": w.base.structure, "criterion": "nullspace"},
)
case(loopid.ExactSearch, lambda w: {"time_limit": 1.0}, time_limit=(0, -1))
case(loopid.ExhaustiveSearch, lambda w: {"workers": 1}, workers=(0,))
case(
    loopid.SubgroupSearch,
    lambda w: {"condition_limit": 100.0, "alpha": 0.25, "variant": "text"},
    alpha=(0, 0.6, *BAD),
    condition_limit=(1,),
)
case(paper.reproduce_paper, lambda w: {"logs": (), "seed": 0, "repetitions": 3})
