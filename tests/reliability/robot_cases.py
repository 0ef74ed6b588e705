"""Functions of a mechanism: where it can be, what its motion weighs."""

import numpy as np
from case_registry import case

import loopid
from loopid import kinematics, loading, mechanism, regressors

# Numbers that are no tolerances, rates or sizes.
BAD = (-1, np.inf)


def of_robot(function, sound=lambda world: {}, **options) -> None:
    case(function, lambda world: {"mechanism": world.robot, **sound(world)}, **options)


def poses(world):
    return {"configurations": world.q}


def motion(world):
    moving = {"velocities": world.rates, "accelerations": world.accelerations}
    return {**poses(world), **moving}


for function in (
    kinematics.constraint_residual, kinematics.constraint_jacobian,
    kinematics.platform_coordinates, regressors.gravity_regressor,
):  # fmt: skip
    of_robot(function, poses)
of_robot(kinematics.constraint_drift, lambda w: {**poses(w), "velocities": w.all_rates})
of_robot(kinematics.scaled_constraint, lambda w: {"q": w.q})
of_robot(
    kinematics.platform_motion,
    lambda w: {**poses(w), "rates": w.rates, "accelerations": w.accelerations},
)
of_robot(kinematics.singularity_measure, lambda w: {**poses(w), "independent": w.robot.independent})
of_robot(
    kinematics.project,
    lambda w: {
        **poses(w),
        "independent_velocities": w.rates,
        "independent": w.robot.independent,
    },
)
of_robot(kinematics.closed_motion, lambda w: {**motion(w), "independent": w.robot.independent})
for function in (kinematics.assemble, kinematics.try_assemble):
    of_robot(
        function,
        lambda w: {
            "values": w.strokes,
            "coordinates": w.robot.measured,
            "start": w.robot.reference.copy(),
            "tolerance": 1e-10,
        },
        tolerance=BAD,
    )
of_robot(kinematics.measured_coordinates, lambda w: {"coordinates": w.robot.measured})
of_robot(
    kinematics.mobility,
    lambda w: {"configuration": w.robot.reference.copy(), "around": w.q},
)
of_robot(
    kinematics.random_configurations,
    lambda w: {"count": 5, "seed": 1, "margin": 0.02},
    count=(0,),
    margin=(-1,),
)
of_robot(
    kinematics.random_motions,
    lambda w: {"count": 5, "seed": 1},
    fine=[("seed", "a number")],
)
of_robot(regressors.dynamic_regressor, motion)
of_robot(
    regressors.tree_regressor,
    lambda w: {
        **poses(w),
        "velocities": w.all_rates,
        "accelerations": w.all_rates,
        "model": "full",
    },
)
of_robot(regressors.force_parts, lambda w: {**motion(w), "standard_parameters": w.parameters})
of_robot(regressors.motion_parameters, lambda w: {"model": "full"})
of_robot(regressors.motion_regressor, lambda w: {"motion": w.whole, "model": "full"})
of_robot(
    regressors.structural_observation,
    lambda w: {"model": "gravity", "samples": 20, "seed": 1, "margin": 0.02},
    samples=(0,),
    margin=(-1,),
)
of_robot(
    loopid.forward_dynamics,
    lambda w: {
        **poses(w),
        "velocities": w.rates,
        "forces": w.rates + 1.0,
        "standard_parameters": w.parameters,
    },
)
of_robot(
    loopid.joint_motion,
    lambda w: {"motion": w.platform_motion, "start": w.robot.reference.copy()},
)
of_robot(loopid.review_motion, lambda w: {"motion": w.motion, "margin": 0.02}, margin=(-1,))
of_robot(
    loopid.simulate_measurement,
    lambda w: {
        "motion": w.motion,
        "noise": loopid.Noise(1.0),
        "seed": 1,
        "standard_parameters": w.parameters,
        "joint_terms": loopid.JointTerms(w.robot.actuated),
        "joint_values": np.ones(2 * len(w.robot.actuated)),
    },
)
of_robot(
    loopid.find_force_model,
    lambda w: {"model": "gravity", "search": "qr", "seed": 1},
)
for function in (mechanism.inertia_defects, mechanism.named_lengths, mechanism.unequal_links):
    of_robot(function)
case(
    mechanism.tie_matrix,
    lambda w: {"links": w.robot.links, "groups": w.robot.identical, "width": 4},
    free=("links",),
)
case(loopid.load_mechanism, lambda w: {"path": w.urdf, "lock": ()}, lock=("elbow",))
case(loading.second_opinion, lambda w: {"path": w.urdf})
case(loading.bundled_robots, lambda w: {})
case(loading.bundled_directory, lambda w: {})
