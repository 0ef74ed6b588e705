"""The Pinocchio path and the symbolic model, derived apart, are the same model."""

import numpy as np
import pytest

from loopid import (
    assemble,
    gravity_regressor,
    load_mechanism,
    platform_coordinates,
    random_configurations,
)
from loopid.paper.symbolic import gravity_regressor as symbolic_regressor
from loopid.paper.symbolic import read_geometry, strokes

POSES = 1000


@pytest.fixture(scope="module", params=[1, 2, 4])
def both(request, generator, write_robot, urdf_folder):
    """A configuration of the 3UPS+RPU for Pinocchio, and its geometry for SymPy."""
    robot = generator.read_table()["3ups_rpu"]
    mechanism = load_mechanism(write_robot(robot["configurations"][request.param], robot))
    geometry = read_geometry(urdf_folder / "geometry.yaml", "3ups_rpu", request.param)
    return mechanism, geometry, random_configurations(mechanism, POSES, seed=request.param)


def test_gravity_regressors_agree(both):
    mechanism, geometry, q = both
    expected = symbolic_regressor(geometry, platform_coordinates(mechanism, q))
    difference = np.abs(gravity_regressor(mechanism, q) - expected).max(axis=(1, 2))
    assert (difference <= 1e-10 * np.abs(expected).max(axis=(1, 2))).all()


def test_inverse_and_forward_kinematics_agree(both):
    mechanism, geometry, q = both
    pose = platform_coordinates(mechanism, q)
    found = assemble(mechanism, strokes(geometry, pose))
    np.testing.assert_allclose(platform_coordinates(mechanism, found), pose, atol=1e-10)
