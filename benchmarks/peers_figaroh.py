"""FIGAROH's chain on given states, with the calls and tolerances of its own UR10 example.

Started by peers.py, in FIGAROH's environment: load_robot, build_regressor_basic,
get_index_eliminate and build_regressor_reduced, double QR, relative_stdev. No decimation: it is
for signals, not for random states.
"""

# FIGAROH lives in an environment of its own.
# mypy: disable-error-code=import-not-found

from __future__ import annotations

import logging
import sys
from pathlib import Path

import numpy as np
from figaroh.identification.identification_tools import relative_stdev
from figaroh.identification.parameter import get_standard_parameters
from figaroh.tools.qrdecomposition import QRDecomposer
from figaroh.tools.regressor import (
    build_regressor_basic,
    build_regressor_reduced,
    get_index_eliminate,
)
from figaroh.tools.robot import load_robot

from measuring import Phases, States, answer, peak_megabytes

ZERO_TOLERANCE = 1e-3  # of BaseIdentification.solve
QR_TOLERANCE = 1e-6  # of BaseIdentification.solve


def main() -> None:
    """Run the chain once and answer with the figures."""
    imports, phases = peak_megabytes(), Phases()
    logging.disable(logging.WARNING)
    states = States.from_argument(sys.argv[1])
    with phases("load"):
        robot = load_robot(states.urdf, package_dirs=package_folder(states.urdf))
    loaded = peak_megabytes()
    q, v, a, force = states.read()
    tau = force.T.ravel()
    options = {
        "has_friction": False,
        "has_actuator_inertia": False,
        "has_joint_offset": False,
        "is_joint_torques": True,
        "act_idxv": list(range(robot.model.nv)),
    }
    with phases("regressor"):
        W = build_regressor_basic(robot, q, v, a, options)
        standard = get_standard_parameters(robot.model, options)
    with phases("zero columns"):
        eliminated, names = get_index_eliminate(W, standard, ZERO_TOLERANCE)
        reduced = build_regressor_reduced(W, eliminated)
    with phases("base parameters"):
        decomposer = QRDecomposer(tolerance=QR_TOLERANCE)
        found = decomposer.double_decomposition(tau, reduced, names, standard)
        W_base, values = found[0], found[3]
    with phases("least squares"):
        relative_stdev(W_base, values, tau)
    answer(
        {
            "seconds": phases.seconds,
            "columns": W.shape[1],
            "with_effect": len(names),
            "rank": len(values),
            "residual": float(np.linalg.norm(tau - W_base @ values)),
            "imports_mb": imports,
            "loaded_mb": loaded,
            "peak_mb": peak_megabytes(),
        }
    )


def package_folder(urdf: str) -> str:
    """Folder that package://example-robot-data stands in, for the meshes."""
    return str(next(p.parent for p in Path(urdf).parents if p.name == "example-robot-data"))


if __name__ == "__main__":
    main()
