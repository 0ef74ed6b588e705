"""Logs, samples and fits."""

import numpy as np
from case_registry import case
from robot_cases import BAD

import loopid
from loopid import experiment, identification, logs, reduction

# Arguments that may be anything of their type.
NAMED = ("name", "joints", "actuators")
ESTIMATOR = {"estimator": "wls"}
# Numbers for all, or one each: how many there are is known only with the data.
SIZED = ("one column more", "one axis more", "a number")


def values(world):
    return {"values": np.array(world.result.values)}


def labels(world):
    return world.samples.parameters.labels[:1]


def data(world):
    """Parts of samples, as arrays."""
    names = ("regressor", "force", "used", "least_errors")
    arrays = {name: np.array(getattr(world.samples, name)) for name in names}
    return {"parameters": world.samples.parameters, "actuators": world.samples.actuators, **arrays}


def samples(world):
    return {"samples": world.samples, **ESTIMATOR}


for function in (loopid.fit, identification.quiet_fit, identification.working_fit):
    case(function, samples)
case(identification.fit_quality, lambda w: {"problem": w.samples.problem, **values(w)})
case(
    identification.fit_in_steps,
    lambda w: {"first": w.samples, "second": w.validation, "known": labels(w), **ESTIMATOR},
)
case(
    loopid.FitSamples.of,
    lambda w: {**data(w), "stretches": np.array(w.samples.stretches)},
    "FitSamples.of",
    free=NAMED,
)
case(identification.FitProblem.from_samples, data, "FitProblem.from_samples", free=NAMED)
for function in (identification.Huber, identification.Bisquare):
    case(function, lambda w: {"tuning": 3.0}, tuning=(0, *BAD))
case(identification.InstrumentalVariables, lambda w: {"weighted": True}, weighted=("x", 3))
case(
    identification.TotalLeastSquares,
    lambda w: {"column_errors": np.full(8, 0.1), "force_errors": np.full(2, 0.1)},
    fine=[(name, what) for name in ("column_errors", "force_errors") for what in SIZED],
)
case(
    identification.BayesianRidge,
    lambda w: {"prior": w.prior, "noise": np.ones(2), "noise_samples": 100.0},
    fine=[("noise", what) for what in SIZED],
    noise_samples=(0, *BAD),
)
case(
    identification.Prior,
    lambda w: {
        "parameters": w.prior.parameters,
        "values": np.array(w.prior.values),
        "covariance": np.array(w.prior.covariance),
    },
    fine=[("covariance", "infinity")],
)
case(
    experiment.cad_prior,
    lambda w: {
        "force_model": w.force_model,
        "relative": 0.3,
        "joint_values": np.ones(4),
        "joint_deviations": np.ones(4),
    },
    relative=(0, *BAD),
)
case(
    reduction.eliminate,
    lambda w: {
        "training": w.samples,
        "validation": w.validation,
        "reference": np.array(w.force_model.prior),
        "keep": labels(w),
        **ESTIMATOR,
    },
)
case(reduction.influence, lambda w: {"data": w.samples, "relative_to": "measured", **values(w)})
for function in (reduction.truncated_values, reduction.truncation_bias):
    case(
        function,
        lambda w: {
            "data": w.samples,
            "kept": 2,
            "weights": np.array(w.result.weights),
            **values(w),
        },
        fine=[("kept", "a number")],
        kept=(0, 100),
    )


def recordings(world):
    return {"training": world.parts[0], "validation": world.parts[1]}


case(
    loopid.identify,
    lambda w: {"force_model": w.force_model, **recordings(w), "n_jobs": 1, **ESTIMATOR},
    training=([],),
    validation=([],),
    n_jobs=(0, True),
)
case(
    loopid.split_recordings,
    lambda w: {"recordings": [w.recording], "fraction": 0.6},
    fraction=(0, 1, *BAD),
)
case(
    loopid.distributed_problem,
    lambda w: {"force_model": w.force_model, "sources": [w.recording]},
    sources=([],),
)
case(
    experiment.identifiability,
    lambda w: {"force_model": w.force_model, "recordings": w.parts[0]},
    recordings=([],),
)
case(
    experiment.exciting_motion,
    lambda w: {"mechanism": w.arm, "wanted": w.wanted_motion, "samples": 8},
    samples=(0, 1),
)
for function in (experiment.prediction_error, experiment.prediction_reach):
    case(
        function,
        lambda w: {
            "regressor": np.array(w.samples.regressor),
            "covariance": np.array(w.result.covariance),
        },
    )
case(loopid.read_log, lambda w: {"path": w.log_file, "mechanism": w.arm})
case(logs.read_mapping, lambda w: {"path": w.mapping_file})
case(
    loopid.prepare_recording,
    lambda w: {
        "mechanism": w.arm,
        "log": w.log,
        "lowpass": loopid.LowPass(2.0),
        "idle_speed": 0.01,
        "saturation": 1e4,
        "start": np.array(w.arm.reference),
    },
    fine=[("idle_speed", "a number"), ("saturation", "a number")],
    saturation=(0, -1),
    idle_speed=(-1,),
)
case(logs.default_lowpass, lambda w: {"log": w.log})
case(
    loopid.Log,
    lambda w: {
        "name": "run",
        "joints": w.log.joints,
        **{
            name: np.array(getattr(w.log, name))
            for name in ("time", "position", "force", "stretches")
        },
    },
    free=NAMED,
)
