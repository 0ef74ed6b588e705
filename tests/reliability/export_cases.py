"""Physical consistency and exports."""

import numpy as np
from case_registry import case
from robot_cases import BAD

from loopid import consistency, export


def prior(world):
    """Standard parameters of the arm, and nothing for its joint terms."""
    base = world.force_model.base
    bodies = world.arm.standard_parameters("gravity")
    return np.concatenate([bodies, np.zeros(len(base.parameters) - len(bodies))])


case(
    consistency.consistent_fit,
    lambda w: {
        "problem": w.full_samples.problem,
        "fit": w.full_result,
        "base": w.full_model.base,
        "prior": np.array(w.full_prior),
        "regularisation": "entropic",
        "strength": 1.0,
        "solver": "log-cholesky",
        "margin": 1e-3,
    },
    strength=(0, *BAD),
    margin=(1, *BAD),
)
case(
    consistency.consistent_parameters,
    lambda w: {
        "base": w.full_model.base,
        "values": w.full_model.base.matrix @ w.full_prior,
        "prior": np.array(w.full_prior),
        "regularisation": "entropic",
        "margin": 1e-3,
    },
    margin=(1, *BAD),
)
case(
    consistency.pseudo_inertia,
    lambda w: {"parameters": w.parameters.reshape(-1, 10)},
    fine=[("parameters", "one axis more")],
)
for function in (consistency.prior_defects, consistency.repaired_prior):
    case(
        function,
        lambda w: {"parameters": w.full_model.base.parameters, "prior": np.array(w.full_prior)},
    )
case(
    consistency.Region.box,
    lambda w: {"lower": -np.ones(3), "upper": np.ones(3)},
    "Region.box",
)
case(export.read_fit, lambda w: {"path": w.fit_file})
case(export.force_model_of, lambda w: {"fit": w.saved_fit, "mechanism": w.arm})
case(export.standard_parameters_of, lambda w: {"fit": w.saved_fit, "model": w.full_model})
case(
    export.updated_robot_file,
    lambda w: {"mechanism": w.arm, "standard_parameters": w.arm.standard_parameters()},
)
case(
    export.export_robot_file,
    lambda w: {
        "mechanism": w.arm,
        "standard_parameters": w.arm.standard_parameters(),
        "path": w.folder / "made.urdf",
        "overwrite": True,
    },
    free=("path",),
    path=(3, None, "made.txt", "/proc/none/made.urdf"),
)
case(
    export.regressor_code,
    lambda w: {"model": w.force_model, "name": "arm", "values": np.array(w.result.values)},
    free=("name",),
    name=("", "1a", "a b", 3),
)
case(
    export.export_regressor,
    lambda w: {
        "model": w.force_model,
        "folder": w.folder / "c",
        "name": "arm",
        "values": np.array(w.result.values),
    },
    free=("name", "folder"),
    folder=(3, None),
)
case(
    export.compile_regressor,
    lambda w: {
        "model": w.force_model,
        "code": export.regressor_code(w.force_model, "arm"),
        "folder": w.folder / "compiled",
    },
)
