"""A robot described in mm is the same robot."""

import numpy as np
import pytest

from loopid import assemble, load_mechanism, project, random_configurations
from loopid.kinematics import singularity_measure, try_assemble

MM = 1000.0
LIMB_4 = ("leg4_revolute", "leg4_stroke", "platform_pitch", "platform_yaw")


def in_millimetres(geometry, robot):
    """A row of the geometry table, and its robot, with every length a thousand times larger."""
    lengths = {
        key: value if key.startswith("beta") else MM * value for key, value in geometry.items()
    }
    x_m, z_m, *angles = robot["home"]
    return lengths, robot | {
        "home": [MM * x_m, MM * z_m, *angles],
        "strokes": {limb: [MM * end for end in ends] for limb, ends in robot["strokes"].items()},
        "inertials": {
            link: [mass, [MM * x for x in centre], [MM**2 * value for value in inertia]]
            for link, (mass, centre, inertia) in robot["inertials"].items()
        },
    }


@pytest.fixture(scope="module", params=["3ups_rpu", "5p", "3ups_rpu welded"])
def pair(request, generator, write_robot, weld):
    name, _, welded = request.param.partition(" ")
    robot = generator.read_table()[name]
    geometry = robot["configurations"][1]
    descriptions = (geometry, robot), in_millimetres(geometry, robot)
    files = [write_robot(*description) for description in descriptions]
    return [load_mechanism(weld(file) if welded else file) for file in files]


@pytest.fixture(scope="module")
def to_mm(pair):
    """Factors (nq,) between the coordinates of the two descriptions."""
    return np.where(np.isin(np.arange(pair[0].model.nv), pair[0].prismatic), MM, 1.0)


def test_the_same_configurations_are_drawn(pair, to_mm):
    metre, millimetre = (random_configurations(robot, 50, seed=4) for robot in pair)
    np.testing.assert_allclose(millimetre, metre * to_mm, rtol=1e-9)


@pytest.mark.parametrize("independent", [None, LIMB_4], ids=["strokes", "limb 4"])
def test_the_singularity_measure_is_the_same(pair, to_mm, independent):
    q = random_configurations(pair[0], 50, seed=4, margin=0)
    metre, millimetre = (
        singularity_measure(robot, q * scales, independent)
        for robot, scales in zip(pair, (1.0, to_mm), strict=True)
    )
    np.testing.assert_allclose(millimetre, metre, rtol=1e-9)


def test_the_same_strokes_can_be_assembled(pair, to_mm):
    # Twice as long a travel as the drives have, so that a good part is out of reach.
    motors = pair[0].velocity_indices(pair[0].actuated)
    centre = pair[0].reference[motors]
    strokes = centre + np.random.default_rng(1).uniform(-0.4, 0.4, size=(100, 4))
    metre, millimetre = (
        try_assemble(robot, strokes * unit) for robot, unit in zip(pair, (1.0, MM), strict=True)
    )
    assert 10 < metre.assembled.sum() < 90
    np.testing.assert_array_equal(millimetre.assembled, metre.assembled)
    reached = metre.assembled
    np.testing.assert_allclose(
        millimetre.configurations[reached], metre.configurations[reached] * to_mm, rtol=1e-6
    )


def test_velocity_maps_differ_by_the_units_alone(pair, to_mm):
    q = random_configurations(pair[0], 10, seed=4)
    metre, millimetre = project(pair[0], q).G, project(pair[1], q * to_mm).G
    motors = pair[0].velocity_indices(pair[0].actuated)
    expected = metre * to_mm[:, None] / to_mm[motors]
    np.testing.assert_allclose(millimetre, expected, rtol=1e-9, atol=1e-12)


def test_platform_poses_are_assembled_in_either_unit(pair, to_mm):
    pose = np.array([[0.05, pair[0].reference[10], 0.1, -0.2]])
    metre, millimetre = (
        assemble(robot, pose * [unit, unit, 1, 1], "platform")
        for robot, unit in zip(pair, (1.0, MM), strict=True)
    )
    np.testing.assert_allclose(millimetre, metre * to_mm, rtol=1e-9)
