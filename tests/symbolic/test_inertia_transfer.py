"""The base parameters: Table II, and the identity that makes them one."""

from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from loopid.paper.symbolic import (
    GRAVITY,
    POSE,
    Geometry,
    base_parameter_rows,
    gravity_model,
    parameter_symbols,
    read_geometry,
)

TABLE = Path(__file__).parents[2] / "urdf" / "geometry.yaml"

# The paper's Table II, rows 9 and 10 as in Table III; the last term of row 9 is its erratum.
TABLE_II = (
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
    for row, printed in zip(rows, TABLE_II, strict=True):
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


def test_coefficients_are_those_printed_for_configuration_1():
    geometry = read_geometry(TABLE, "3ups_rpu", 1)
    row_9, row_10 = (row.coefficients(geometry) for row in base_parameter_rows()[8:10])
    assert row_9 == pytest.approx(
        {"leg1_stem.m": -0.3, "leg2_stem.m": 0.1928, "leg3_stem.m": 0.0, "platform.mx": 1.0},
        abs=5e-5,
    )
    assert row_10 == pytest.approx(
        {"leg2_stem.m": 0.2298, "leg3_stem.m": -0.3, "platform.my": 1.0}, abs=5e-5
    )
