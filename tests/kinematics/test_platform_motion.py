"""Platform coordinates of closed configurations, and motions given by them."""

import numpy as np
import pytest

from loopid.errors import DataError, OptionError
from loopid.kinematics import assemble, constraint_drift, constraint_jacobian, platform_coordinates
from loopid.kinematics.measured import platform_motion

RATES = np.array([0.05, -0.04, 0.3, -0.2])
ACCELERATIONS = np.array([-0.1, 0.2, 0.5, 0.4])


@pytest.fixture
def moved(mechanism, poses):
    """Configurations a time t later, the platform coordinates moving with constant acceleration."""
    pose = platform_coordinates(mechanism, poses)

    def at(t):
        targets = pose + t * RATES + t**2 / 2 * ACCELERATIONS
        return assemble(mechanism, targets, "platform")

    return at


def solved(mechanism, q):
    same = (len(q), 1)
    return platform_motion(mechanism, q, np.tile(RATES, same), np.tile(ACCELERATIONS, same))


def test_velocities_and_accelerations_are_derivatives_of_assembled_motion(mechanism, moved):
    h = 1e-4
    before, now, after = moved(-h), moved(0.0), moved(h)
    v, a = solved(mechanism, now)
    np.testing.assert_allclose(v, (after - before) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(a, (after - 2 * now + before) / h**2, atol=1e-5)


def test_the_loops_stay_closed(mechanism, poses):
    v, a = solved(mechanism, poses)
    A = constraint_jacobian(mechanism, poses)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", A, v), 0, atol=1e-13)
    second = np.einsum("nij,nj->ni", A, a) + constraint_drift(mechanism, poses, v)
    np.testing.assert_allclose(second, 0, atol=1e-12)


def test_wrong_input_is_refused(mechanism, poses, four_bars):
    with pytest.raises(DataError) as error:
        platform_motion(mechanism, poses, np.zeros((len(poses), 3)), np.zeros((len(poses), 4)))
    assert error.value.facts["argument"] == "platform rates"
    bar = four_bars["3d"]
    with pytest.raises(OptionError) as none:
        platform_motion(bar, bar.reference[None], np.zeros((1, 1)), np.zeros((1, 1)))
    assert none.value.facts["robot"] == bar.name


def test_strokes_lead_to_the_oracles_poses(mechanism, oracle):
    home = assemble(mechanism, oracle["home"], "platform")
    for start in (mechanism.reference, home):
        q = assemble(mechanism, oracle["strokes"], start=start)
        np.testing.assert_allclose(platform_coordinates(mechanism, q), oracle["pose"], atol=1e-10)


def test_poses_lead_to_the_oracles_strokes(mechanism, oracle):
    q = assemble(mechanism, oracle["pose"], "platform")
    strokes = q[:, mechanism.velocity_indices(mechanism.actuated)]
    np.testing.assert_allclose(strokes, oracle["strokes"], atol=1e-13)
