"""Laws of mechanics that hold for every geometry and every regular pose."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from loopid.paper.symbolic import (
    GRAVITY,
    GRAVITY_LABELS,
    Geometry,
    base_parameter_rows,
    base_regressor,
    gravity_regressor,
    stroke_jacobian,
    strokes,
)

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
law = settings(max_examples=30, deadline=None)


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
@given(GEOMETRIES, POSES, PARAMETERS)
def test_base_parameters_give_the_forces_of_the_standard_ones(geometry, pose, parameters):
    assume_regular(geometry, pose)
    values = dict(zip(GRAVITY_LABELS, parameters, strict=True))
    base_values = [
        sum(c * values[label] for label, c in row.coefficients(geometry).items())
        for row in base_parameter_rows()
    ]
    K, K_base = gravity_regressor(geometry, pose)[0], base_regressor(geometry, pose)[0]
    scale = np.linalg.norm(K) * np.linalg.norm(parameters)
    np.testing.assert_allclose(K @ parameters, K_base @ base_values, atol=1e-11 * scale)


@law
@given(GEOMETRIES)
def test_the_omitted_term_of_row_9_vanishes_only_at_a_right_angle(geometry):
    row = base_parameter_rows()[8]
    assert row.coefficients(geometry)["leg3_stem.m"] == pytest.approx(
        geometry.Rm3 * np.cos(geometry.beta_MI), abs=1e-15
    )
    square = replace(geometry, beta_MI=np.pi / 2)
    assert abs(row.coefficients(square)["leg3_stem.m"]) < 1e-16
