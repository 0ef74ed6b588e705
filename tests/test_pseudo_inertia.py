"""Pseudo-inertias: what they are of, and the maps between their forms."""

import numpy as np
import pinocchio as pin
from hypothesis import given, strategies as st

from loopid.inertia import parameters_of, pseudo_inertia, upper_factor

seeds = st.integers(0, 2**32 - 1)


def random_symmetric(seed, count=3):
    A = np.random.default_rng(seed).normal(size=(count, 4, 4))
    return A + np.swapaxes(A, -1, -2)


@given(seeds, st.integers(1, 8))
def test_it_is_the_second_moment_of_mass_points(seed, count):
    generator = np.random.default_rng(seed)
    masses, points = generator.uniform(0.1, 2, count), generator.normal(size=(count, 3))
    inertia = pin.Inertia.Zero()
    for mass, point in zip(masses, points, strict=True):
        inertia += pin.Inertia(mass, point, np.zeros((3, 3)))
    homogeneous = np.column_stack([points, np.ones(count)])
    expected = np.einsum("k,ki,kj->ij", masses, homogeneous, homogeneous)
    found = pseudo_inertia(inertia.toDynamicParameters())
    np.testing.assert_allclose(found, expected, atol=1e-12)


@given(seeds)
def test_parameters_come_back(seed):
    P = random_symmetric(seed)
    np.testing.assert_allclose(pseudo_inertia(parameters_of(P)), P, atol=1e-12)


@given(seeds)
def test_upper_factors_multiply_to_the_matrix(seed):
    A = np.random.default_rng(seed).normal(size=(3, 4, 4))
    P = A @ np.swapaxes(A, -1, -2) + 0.1 * np.eye(4)
    L = upper_factor(P)
    np.testing.assert_allclose(L @ np.swapaxes(L, -1, -2), P, atol=1e-12)
    np.testing.assert_array_equal(L, np.triu(L))
    assert (np.diagonal(L, axis1=-2, axis2=-1) > 0).all()
