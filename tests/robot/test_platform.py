"""Platform coordinates: products of elementary motions, and back."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from loopid.errors import DataError
from loopid.robot import Platform
from loopid.robot.platform import ROTATIONS, TRANSLATIONS

some_translations = st.lists(st.sampled_from(TRANSLATIONS), unique=True)
some_turns = st.sampled_from([turns for n in range(4) for turns in permutations(ROTATIONS, n)])


@st.composite
def platforms(draw):
    """A platform with its turns in any order, the translations anywhere among them."""
    motions = [*draw(some_turns)]
    for translation in draw(some_translations):
        motions.insert(draw(st.integers(0, len(motions))), translation)
    if not motions:
        motions = ["x"]
    names = tuple(f"coordinate_{k}" for k in range(len(motions)))
    return Platform("platform", 0, names, tuple(motions))


def draw_values(platform, seed):
    # Middle angles stay clear of a quarter turn, where the outer two become one.
    generator = np.random.default_rng(seed)
    return generator.uniform(-1.3, 1.3, size=(4, len(platform.motions)))


def turn(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"rx": (1, 2), "ry": (2, 0), "rz": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return matrix


@given(platforms(), st.integers(0, 2**32 - 1))
def test_coordinates_invert_placements(platform, seed):
    values = draw_values(platform, seed)
    again = platform.coordinates(*platform.placements(values))
    np.testing.assert_allclose(again, values, atol=1e-12)


@given(platforms(), st.integers(0, 2**32 - 1))
def test_a_placement_is_the_product_of_its_motions(platform, seed):
    values = draw_values(platform, seed)
    rotations, origins = platform.placements(values)
    for row, rotation, origin in zip(values, rotations, origins, strict=True):
        expected_rotation, expected_origin = np.eye(3), np.zeros(3)
        for motion, value in zip(platform.motions, row, strict=True):
            if motion in TRANSLATIONS:
                expected_origin["xyz".index(motion)] = value
            else:
                expected_rotation = expected_rotation @ turn(motion, value)
        np.testing.assert_allclose(rotation, expected_rotation, atol=1e-14)
        np.testing.assert_array_equal(origin, expected_origin)


def test_coordinates_of_the_wrong_width_are_refused(mechanism):
    with pytest.raises(DataError, match=r"platform coordinates.*\(samples, 4\)"):
        mechanism.platform.placements(np.zeros((2, 3)))
