"""The Pinocchio path against the symbolic model: same numbers, and how fast.

    python benchmarks/symbolic.py [--poses N] [--json FILE]

Gravity regressors at random closed poses of three configurations of the 3UPS+RPU, and the
coefficients of all base parameters against their closed forms.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

import loopid
from loopid import Robot, random_configurations
from loopid.base_parameters import find_base
from loopid.kinematics import platform_coordinates
from loopid.paper.symbolic import (
    Geometry,
    base_parameter_rows,
    gravity_regressor as symbolic_regressor,
    read_geometry,
)
from loopid.regressors import gravity_regressor, structural_observation
from tables import show, write_json

URDF = Path(__file__).parents[1] / "urdf"
ROBOT, CONFIGURATIONS = "3ups_rpu", (1, 2, 4)


def main() -> None:
    """Print the comparison and write it on request."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--poses", type=int, default=1000)
    parser.add_argument("--json", metavar="FILE", help="write the figures to a file")
    arguments = parser.parse_args()
    rows = [compare(configuration, arguments.poses) for configuration in CONFIGURATIONS]
    show("Pinocchio path against the symbolic model", rows)
    if arguments.json:
        write_json(arguments.json, {"configurations": rows})


def compare(configuration: int, poses: int) -> dict[str, Any]:
    """Largest differences between the two paths, and their times per pose."""
    mechanism = generated(configuration)
    geometry = read_geometry(URDF / "geometry.yaml", ROBOT, configuration)
    q = random_configurations(mechanism, poses, seed=configuration)
    pose = platform_coordinates(mechanism, q)
    symbolic_regressor(geometry, pose[:1])  # derives and compiles once
    start = perf_counter()
    expected = symbolic_regressor(geometry, pose)
    between = perf_counter()
    found = gravity_regressor(mechanism, q)
    end = perf_counter()
    error = np.abs(found - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))
    return {
        "configuration": configuration,
        "poses": poses,
        "largest_relative_difference": float(error.max()),
        "largest_coefficient_difference": coefficient_difference(mechanism, geometry),
        "symbolic_us_per_pose": 1e6 * (between - start) / poses,
        "pinocchio_us_per_pose": 1e6 * (end - between) / poses,
    }


def generated(configuration: int) -> Robot:
    """Generate and load a configuration."""
    sys.path.insert(0, str(URDF))
    from generate import read_table, robot_files

    robot = read_table()[ROBOT]
    with TemporaryDirectory() as folder:
        files = robot_files(ROBOT, robot["configurations"][configuration], robot)
        files.write(Path(folder), ROBOT)
        return loopid.load(Path(folder) / f"{ROBOT}.yaml")


def coefficient_difference(mechanism: Robot, geometry: Geometry) -> float:
    """Largest difference between numeric and symbolic coefficients of the base parameters."""
    base = find_base(structural_observation(mechanism))
    labels = base.parameters.labels
    symbolic = np.zeros((len(base_parameter_rows()), len(labels)))
    for row, terms in zip(symbolic, base_parameter_rows(), strict=True):
        for label, value in terms.coefficients(geometry).items():
            row[labels.index(label)] = value
    # Rows correspond by content: each numeric row is closest to exactly one symbolic row.
    distances = np.abs(base.matrix[:, None] - symbolic[None]).max(axis=2)
    nearest = distances.argmin(axis=1)
    if len(set(nearest)) != len(symbolic):
        return float("inf")
    return float(distances.min(axis=1).max())


if __name__ == "__main__":
    main()
