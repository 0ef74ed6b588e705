"""Where the motors lose control: measured, warned of and refused."""

import warnings

import numpy as np
import pytest
from scipy.optimize import brentq

from loopid import assemble, project, singularity_measure
from loopid.errors import SingularityError, SingularityWarning
from loopid.kinematics import NEAR_SINGULARITY, mobility

LIMB_4 = ("leg4_revolute", "leg4_stroke", "platform_pitch", "platform_yaw")
# Published for the 3UPS+RPU at x_m = 0, z_m = 0.7 m, theta = 0: yaw (rad), determinant (m²).
PUBLISHED = {-0.3: 0.0445, 0.0: 0.0273, 0.2: 0.0141, 0.4: 0.0032}


def at_yaw(knee, yaw):
    poses = np.array([[0, 0.7, 0, yaw] for yaw in np.atleast_1d(yaw)])
    return assemble(knee, poses, "platform")


def stroke_determinant(knee, q):
    """Determinant (N,) of the strokes' derivative by x_m, z_m, theta, psi.

    Limb 4 is a pair of polar coordinates of (x_m, z_m), whose radius is its stroke.
    """
    G = project(knee, q, independent=LIMB_4).G
    strokes = knee.velocity_indices(knee.actuated)
    radius = q[:, knee.velocity_indices(["leg4_stroke"])][:, 0]
    return np.linalg.det(G[:, strokes]) / radius


@pytest.fixture(scope="module")
def singular_yaw(knee):
    return brentq(lambda yaw: stroke_determinant(knee, at_yaw(knee, yaw))[0], 0.4, 0.6, xtol=1e-14)


def test_the_stroke_jacobian_has_the_published_determinants(knee):
    found = stroke_determinant(knee, at_yaw(knee, list(PUBLISHED)))
    np.testing.assert_allclose(np.abs(found), list(PUBLISHED.values()), atol=5e-5)


def test_the_measure_vanishes_at_the_singularity_and_nowhere_near(knee, singular_yaw):
    distances = np.array([0.0, 1e-6, 1e-4, 1e-2])
    measures = singularity_measure(knee, at_yaw(knee, singular_yaw - distances))
    assert measures[0] < 1e-10
    # It grows with the distance, linearly at first.
    np.testing.assert_allclose(measures[1:3] / measures[2], distances[1:3] / 1e-4, rtol=1e-2)
    assert measures[3] > 50 * measures[2]


def test_a_singular_configuration_is_refused_by_sample(knee, singular_yaw):
    q = at_yaw(knee, [0.0, singular_yaw, 0.1])
    with pytest.raises(SingularityError, match=r"sample 1 is singular.* 8 of 9 .*1 such samples"):
        project(knee, q)


def test_a_configuration_near_it_is_warned_of_by_sample(knee, singular_yaw):
    q = at_yaw(knee, [0.0, singular_yaw - 1e-4, singular_yaw - 1e-3])
    measure = singularity_measure(knee, q)
    assert (measure[1:] < NEAR_SINGULARITY).all()
    assert measure[0] > NEAR_SINGULARITY
    with pytest.warns(SingularityWarning, match=r"2 samples are near .* first sample 1 "):
        projection = project(knee, q)
    np.testing.assert_array_equal(projection.singularity, measure)


def test_regular_configurations_pass_in_silence(mechanism, poses):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (project(mechanism, poses).singularity > NEAR_SINGULARITY).all()


def test_other_independent_joints_are_regular_where_the_motors_are_singular(knee, singular_yaw):
    q = at_yaw(knee, singular_yaw)
    assert project(knee, q, independent=LIMB_4).singularity[0] > 0.01


def test_the_motion_that_the_motors_lose_is_named(knee, singular_yaw):
    found = mobility(knee, at_yaw(knee, singular_yaw)[0])
    assert found.degrees_of_freedom == 4
    assert "platform_yaw" in found.undetermined
    assert not set(found.undetermined) & set(knee.actuated)


def test_the_motors_hold_every_joint_at_the_reference(mechanism):
    found = mobility(mechanism)
    assert (found.rows, found.rank, found.degrees_of_freedom) == (9, 9, 4)
    assert found.undetermined == ()
    assert found.rank_gap == np.inf


@pytest.mark.parametrize(("kind", "rows", "rank"), [("3d", 3, 2), ("6d", 6, 3)])
def test_redundant_rows_of_a_planar_loop_are_counted_once(four_bars, kind, rows, rank):
    found = mobility(four_bars[kind])
    assert (found.rows, found.rank, found.degrees_of_freedom) == (rows, rank, 1)
    assert found.rank_gap > 1e12


@pytest.mark.parametrize("place", [3, 700, 1199])
def test_one_singular_configuration_among_many_is_refused_by_sample(knee, singular_yaw, place):
    q = np.repeat(at_yaw(knee, 0.1), 1200, axis=0)
    q[place] = at_yaw(knee, singular_yaw)[0]
    with pytest.raises(SingularityError, match=rf"sample {place} is singular.* 1 such samples"):
        project(knee, q)


def test_those_near_it_among_many_are_counted_and_no_others(knee, singular_yaw):
    q = np.repeat(at_yaw(knee, 0.1), 1200, axis=0)
    near = [5, 600, 1100]
    q[near] = at_yaw(knee, singular_yaw - 1e-4)
    with pytest.warns(SingularityWarning, match=r"3 samples are near .* first sample 5 "):
        projection = project(knee, q)
    alone = project(knee, at_yaw(knee, 0.1))
    regular = np.delete(np.arange(1200), near)
    same = np.broadcast_to(alone.G, projection.G[regular].shape)
    np.testing.assert_allclose(projection.G[regular], same, rtol=0, atol=1e-12)
    np.testing.assert_allclose(projection.singularity[regular], alone.singularity[0], rtol=1e-12)
