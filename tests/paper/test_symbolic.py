"""The symbolic model: geometry, gravity, base parameters, and the laws of mechanics that hold."""

import math
import subprocess
import sys
from math import cos
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings, strategies as st
from scipy.optimize import brentq

import loopid
from loopid import random_configurations
from loopid.errors import DataError, SingularityError
from loopid.kinematics import assemble, platform_coordinates
from loopid.paper.symbolic import (
    GRAVITY,
    GRAVITY_LABELS,
    POSE,
    Geometry,
    base_parameter_rows,
    gravity_model,
    gravity_regressor,
    parameter_symbols,
    read_geometry,
    stroke_jacobian,
    strokes,
)
from loopid.regressors import gravity_regressor as numeric_regressor

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "urdf" / "geometry.yaml"
ORACLE = ROOT.parent / "shared" / "data" / "oracle"

# Geometry


def test_angles_are_read_in_degrees_and_kept_in_radians():
    geometry = read_geometry(TABLE, "3ups_rpu", 1)
    assert geometry.beta_MI == math.radians(90)
    assert len(geometry.symbols()) == len(geometry) == len(Geometry._fields)
    with pytest.raises(AttributeError):
        geometry.R1 = 1.0


# Gravity

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


def test_rank_is_15(geometry, poses):
    singular_values = np.linalg.svd(gravity_regressor(geometry, poses).reshape(-1, 36))[1]
    assert singular_values[15] < 1e-10 * singular_values[14]


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
    beside_base = geometry._replace(R1=geometry.Rm1 * cos(0.5))
    for changed, pose, reason in (
        (beside_base, [0.0, 0.0, 0.0, 0.5], "parallel to Y_F"),
        (geometry, [geometry.ds, 0.0, 0.1, 0.1], "no length"),
    ):
        with pytest.raises(SingularityError, match=rf"1 of 2 poses: .*{reason}.* pose 1"):
            gravity_regressor(changed, [[0.05, 0.7, 0.1, -0.1], pose])


# Base parameters by inertia transfer

# The paper's Table II, rows 9 and 10 as in Table III; the last term of row 9 is its erratum.
ROWS = (
    "m_12 + m_22 + m_32 + m_42 + m_m",
    "mx_11 + mx_12",
    "mx_21 + mx_22",
    "mz_11 + mz_12",
    "mz_21 + mz_22",
    "mz_31 + mz_32",
    "mx_31 + mx_32",
    "my_42 - mz_41",
    "R_m2*cos(beta_MD)*m_22 - R_m1*m_12 + mx_m + R_m3*cos(beta_MI)*m_32",
    "R_m2*sin(beta_MD)*m_22 - R_m3*sin(beta_MI)*m_32 + my_m",
    "mz_m",
    "mx_42 - mx_41",
    "my_11 + my_12",
    "my_21 + my_22",
    "my_31 + my_32",
)


def test_rows_are_those_of_table_ii():
    rows = base_parameter_rows()
    assert [row.number for row in rows] == list(range(1, 16))
    for row, printed in zip(rows, ROWS, strict=True):
        assert sp.expand(row.expression - sp.sympify(printed)) == 0


def test_potential_energy_is_the_base_parameters_times_their_atoms():
    """The identity, for symbolic geometry: the difference does not depend on the pose."""
    energy = gravity_model().energy.dot(list(parameter_symbols().values()))
    transferred = GRAVITY * sum(row.expression * row.atom for row in base_parameter_rows())
    difference = sp.expand(energy - transferred)
    assert [difference.diff(coordinate).expand() for coordinate in POSE] == [0, 0, 0, 0]


def test_atoms_are_independent_for_a_generic_geometry():
    """No combination of the atoms' gradients vanishes, so no base parameter can be spared."""
    generic = (0.41, 0.37, 0.44, 0.13, 1.31, 0.83, 0.29, 0.27, 0.31, 0.71, 1.13)
    gradients = sp.Matrix([row.atom for row in base_parameter_rows()]).jacobian(POSE).T
    evaluate = sp.lambdify((*POSE, *Geometry.symbols()), gradients, "numpy", cse=True)
    poses = np.random.default_rng(1).uniform([-0.2, 0.6, -0.3, -0.5], [0.2, 0.8, 0.3, 0.5], (30, 4))
    stacked = np.vstack([evaluate(*pose, *generic) for pose in poses])
    singular_values = np.linalg.svd(stacked / np.linalg.norm(stacked, axis=0))[1]
    assert singular_values[-1] > 1e-3 * singular_values[0]


# Laws for every geometry and every regular pose

STEP = 1e-5  # central differences: truncation and round-off both near 1e-10 of the values
ANGLES = st.floats(5.0, 90.0)
GEOMETRIES = st.builds(
    Geometry.from_degrees,
    **dict.fromkeys(("R1", "R2", "R3"), st.floats(0.3, 0.6)),
    ds=st.floats(0.0, 0.2),
    **dict.fromkeys(("Rm1", "Rm2", "Rm3"), st.floats(0.1, 0.35)),
    **dict.fromkeys(("beta_FD", "beta_FI", "beta_MD", "beta_MI"), ANGLES),
)
POSES = st.tuples(
    st.floats(-0.2, 0.2), st.floats(0.6, 0.9), st.floats(-0.35, 0.35), st.floats(-0.5, 0.5)
).map(np.array)
PARAMETERS = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).normal(size=36))
law = settings(max_examples=12, deadline=None)


def gradient(function, pose):
    """Central differences with respect to the pose, in the last axis."""
    moves = STEP * np.eye(4)
    return np.stack(
        [(function(pose + move) - function(pose - move)) / (2 * STEP) for move in moves], axis=-1
    )


def potential_energy(geometry, pose, parameters):
    """Written from joint angles and the platform points, without the package's frames."""
    x, z, theta, psi = pose
    c_t, s_t, c_p, s_p = np.cos(theta), np.sin(theta), np.cos(psi), np.sin(psi)
    R = np.array([[c_t * c_p, -c_t * s_p, s_t], [s_p, c_p, 0], [-s_t * c_p, s_t * s_p, c_t]])
    g = geometry
    base = leg_points(g.R1, g.R2, g.R3, g.beta_FD, g.beta_FI)
    platform = leg_points(g.Rm1, g.Rm2, g.Rm3, g.beta_MD, g.beta_MI)
    rows = []
    for A, B in zip(base, platform, strict=True):
        tip = np.array([x, 0, z]) + R @ B
        dx, dy, dz = tip - A
        q1, q2 = np.arctan2(dz, dx), np.arctan2(np.hypot(dx, dz), -dy)
        axes = [np.sin(q1) * np.cos(q2), np.cos(q1), np.sin(q1) * np.sin(q2)]
        rows += [[0.0, *axes], [tip[2], *axes]]
    q41 = np.arctan2(g.ds - x, z)
    rows += [[0.0, np.sin(q41), 0.0, np.cos(q41)], [z, -np.sin(q41), -np.cos(q41), 0.0]]
    return 9.81 * np.ravel([*rows, [z, *R[2]]]) @ parameters


def leg_points(r1, r2, r3, right, left):
    return (
        np.array([-r1, 0, 0]),
        r2 * np.array([np.cos(right), np.sin(right), 0]),
        r3 * np.array([np.cos(left), -np.sin(left), 0]),
    )


def assume_regular(geometry, pose):
    assume(np.linalg.cond(stroke_jacobian(geometry, pose)[0]) < 1e4)


@law
@given(GEOMETRIES, POSES)
def test_jacobian_is_the_derivative_of_the_strokes(geometry, pose):
    expected = gradient(lambda x: strokes(geometry, x)[0], pose)
    np.testing.assert_allclose(stroke_jacobian(geometry, pose)[0], expected, atol=1e-8)


@law
@given(GEOMETRIES, POSES, PARAMETERS)
def test_actuators_do_the_work_that_raises_the_potential_energy(geometry, pose, parameters):
    assume_regular(geometry, pose)
    forces = gravity_regressor(geometry, pose)[0] @ parameters
    power = gradient(lambda x: strokes(geometry, x)[0], pose).T @ forces
    expected = gradient(lambda x: potential_energy(geometry, x, parameters), pose)
    scale = 9.81 * np.linalg.norm(parameters) + np.linalg.norm(forces)
    np.testing.assert_allclose(power, expected, atol=1e-8 * scale)


@law
@given(GEOMETRIES, POSES, st.floats(1.0, 20.0))
def test_a_point_mass_at_the_platform_origin_loads_only_z(geometry, pose, mass):
    assume_regular(geometry, pose)
    forces = gravity_regressor(geometry, pose)[0, :, GRAVITY_LABELS.index("platform.m")] * mass
    load = stroke_jacobian(geometry, pose)[0].T @ forces
    np.testing.assert_allclose(load, [0, GRAVITY * mass, 0, 0], atol=1e-9 * np.abs(forces).max())


@law
@given(GEOMETRIES)
def test_the_omitted_term_of_row_9_vanishes_only_at_a_right_angle(geometry):
    row = base_parameter_rows()[8]
    assert row.coefficients(geometry)["leg3_stem.m"] == pytest.approx(
        geometry.Rm3 * np.cos(geometry.beta_MI), abs=1e-15
    )
    square = geometry._replace(beta_MI=np.pi / 2)
    assert abs(row.coefficients(square)["leg3_stem.m"]) < 1e-16


# The Pinocchio path, derived apart, is the same model

POSES = 100


@pytest.fixture(scope="module", params=[1, 4])
def both(request, generator, write_robot):
    """A configuration of the 3UPS+RPU for Pinocchio, and its geometry for SymPy."""
    robot = generator.read_table()["3ups_rpu"]
    mechanism = loopid.load(write_robot(robot["configurations"][request.param], robot))
    geometry = read_geometry(TABLE, "3ups_rpu", request.param)
    return mechanism, geometry, random_configurations(mechanism, POSES, seed=request.param)


def test_gravity_regressors_agree(both):
    mechanism, geometry, q = both
    expected = gravity_regressor(geometry, platform_coordinates(mechanism, q))
    difference = np.abs(numeric_regressor(mechanism, q) - expected).max(axis=(1, 2))
    assert (difference <= 1e-10 * np.abs(expected).max(axis=(1, 2))).all()


def test_inverse_and_forward_kinematics_agree(both):
    mechanism, geometry, q = both
    pose = platform_coordinates(mechanism, q)
    found = assemble(mechanism, strokes(geometry, pose))
    np.testing.assert_allclose(platform_coordinates(mechanism, found), pose, atol=1e-10)


WITHOUT_SYMPY = """
import sys
sys.modules["sympy"] = None
from loopid.errors import MissingExtraError
try:
    import loopid.paper.symbolic
except MissingExtraError as error:
    sys.exit(0 if "symbolic" in str(error) else "the extra is not named")
sys.exit("no error")
"""


def test_missing_sympy_names_the_extra():
    done = subprocess.run([sys.executable, "-c", WITHOUT_SYMPY], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
