import numpy as np
import pytest

from loopid.excitation.shapes import FourierShape, PosesShape

SHAPES = [FourierShape(7.0, 4), PosesShape(7.0, 4)]


@pytest.fixture(params=SHAPES, ids=lambda shape: type(shape).__name__)
def shape(request):
    return request.param


def drawn(shape):
    return shape.draw(np.random.default_rng(0), 3) + np.outer(shape.still(), [1.0, -2.0, 0.5])


def test_motions_start_and_end_at_rest_at_one_place(shape):
    ends = shape.functions(np.array([0.0, shape.seconds])) @ drawn(shape)
    np.testing.assert_allclose(ends[0, 0], ends[0, 1], atol=1e-12)
    np.testing.assert_allclose(ends[1:], 0.0, atol=1e-11)


def test_rates_are_derivatives(shape):
    time, step = np.linspace(0.3, 6.6, 50), 1e-5
    _, v, a = shape.functions(time) @ drawn(shape)
    ahead, back = (shape.functions(time + sign * step) @ drawn(shape) for sign in (1, -1))
    np.testing.assert_allclose((ahead[0] - back[0]) / (2 * step), v, atol=1e-6)
    np.testing.assert_allclose((ahead[1] - back[1]) / (2 * step), a, atol=1e-4)


def test_standing_still_is_one_of_the_motions(shape):
    time = shape.grid()
    still = shape.functions(time) @ np.outer(shape.still(), [3.0])
    np.testing.assert_allclose(still[0], 3.0, atol=1e-12)
    np.testing.assert_allclose(still[1:], 0.0, atol=1e-10)


def test_waypoints_make_the_same_motion(shape):
    X = drawn(shape)
    motion = shape.motion(("a", "b", "c"), X, rate=50.0)
    x, v, a = shape.functions(motion.time) @ X
    np.testing.assert_allclose(motion.position, x, atol=1e-11)
    np.testing.assert_allclose(motion.velocity, v, atol=1e-10)
    np.testing.assert_allclose(motion.acceleration, a, atol=1e-9)


def test_poses_are_stood_in():
    time = np.linspace(0, 8, 801)
    rates = PosesShape(8.0, 4).functions(time)[1]
    assert (rates == 0).all(axis=1).mean() == pytest.approx(0.5, abs=0.01)
