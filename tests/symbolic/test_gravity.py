"""The gravity regressor against independent values, its structure and its refusals."""

from dataclasses import replace
from math import cos
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from loopid.errors import DataError, SingularityError
from loopid.paper.symbolic import (
    GRAVITY_LABELS,
    POSE,
    Geometry,
    base_regressor,
    gravity_model,
    gravity_regressor,
    parameter_symbols,
    read_geometry,
    stroke_jacobian,
    strokes,
)

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "urdf" / "geometry.yaml"
ORACLE = ROOT.parent / "shared" / "data" / "oracle"
CONFIGURATIONS = [*(("3ups_rpu", number) for number in (1, 2, 4, 8)), ("5p", 1)]
HOME = [0.0, 0.7, 0.0, 0.0]


@pytest.fixture(params=CONFIGURATIONS, ids=lambda pair: f"{pair[0]}-{pair[1]}")
def geometry(request):
    return read_geometry(TABLE, *request.param)


@pytest.fixture
def poses():
    low, high = [-0.2, 0.6, -0.3, -0.5], [0.2, 0.8, 0.3, 0.1]
    return np.random.default_rng(0).uniform(low, high, size=(60, 4))


@pytest.mark.skipif(not ORACLE.is_dir(), reason="the independent gravity fixtures are not here")
@pytest.mark.parametrize("robot", ["3ups_rpu", "5p"])
def test_agrees_with_the_independent_evaluation(robot):
    with np.load(ORACLE / f"gravity_{robot}.npz") as oracle:
        geometry = read_geometry(TABLE, robot, 1)
        names = [symbol.name.replace("_", "") for symbol in parameter_symbols().values()]
        assert names == list(oracle["columns"])
        np.testing.assert_allclose(strokes(geometry, oracle["pose"]), oracle["strokes"], rtol=1e-13)
        K = gravity_regressor(geometry, oracle["pose"])
        error = np.linalg.norm(K - oracle["K"], axis=(1, 2))
        assert np.all(error < 1e-12 * np.linalg.norm(oracle["K"], axis=(1, 2)))


def test_six_parameters_never_matter(geometry, poses):
    K = gravity_regressor(geometry, poses)
    zero = {label for label, column in zip(GRAVITY_LABELS, K.T, strict=True) if not column.any()}
    cylinders = {f"leg{leg}_cylinder.m" for leg in (1, 2, 3, 4)}
    assert zero == cylinders | {"leg4_cylinder.my", "leg4_stem.mz"}


def test_rank_is_15_and_the_base_regressor_has_it(geometry, poses):
    singular_values = np.linalg.svd(gravity_regressor(geometry, poses).reshape(-1, 36))[1]
    assert singular_values[15] < 1e-10 * singular_values[14]
    assert np.linalg.matrix_rank(base_regressor(geometry, poses).reshape(-1, 15)) == 15


def test_symbols_are_only_pose_and_geometry():
    model = gravity_model()
    free = model.jacobian.free_symbols | model.power.free_symbols
    assert free <= {*POSE, *Geometry.symbols()}
    assert gravity_model() is model


def test_one_pose_and_none_keep_the_sample_axis(geometry):
    assert gravity_regressor(geometry, HOME).shape == (1, 4, 36)
    assert gravity_regressor(geometry, np.empty((0, 4))).shape == (0, 4, 36)


@pytest.mark.parametrize("poses", [np.zeros((2, 3)), np.zeros((1, 2, 4)), [[0, np.nan, 0, 0]]])
def test_wrong_poses_are_refused(geometry, poses):
    with pytest.raises(DataError, match="poses"):
        gravity_regressor(geometry, poses)


def test_a_type_ii_singularity_is_refused():
    """On the way to positive psi det J changes sign; at its root no actuator forces balance."""
    geometry = read_geometry(TABLE, "3ups_rpu", 1)

    def determinant(psi):
        return np.linalg.det(stroke_jacobian(geometry, [0.0, 0.7, 0.0, psi])[0])

    psi = brentq(determinant, 0.0, 0.8, xtol=1e-16, rtol=1e-15)
    with pytest.raises(SingularityError, match=r"1 of 2 poses: type II.* pose 1"):
        gravity_regressor(geometry, [HOME, [0.0, 0.7, 0.0, psi]])


def test_limbs_in_singular_positions_are_named():
    geometry = read_geometry(TABLE, "3ups_rpu", 1)
    beside_base = replace(geometry, R1=geometry.Rm1 * cos(0.5))
    for changed, pose, reason in (
        (beside_base, [0.0, 0.0, 0.0, 0.5], "parallel to Y_F"),
        (geometry, [geometry.ds, 0.0, 0.1, 0.1], "no length"),
    ):
        with pytest.raises(SingularityError, match=rf"1 of 2 poses: .*{reason}.* pose 1"):
            gravity_regressor(changed, [[0.05, 0.7, 0.1, -0.1], pose])
