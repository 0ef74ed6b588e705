"""Motions: derivatives that are derivatives, smooth turns, and the ends that were asked for."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from loopid.errors import DataError, OptionError
from loopid.motion import FourierSeries, JointMotion, Motion, Waypoint, point_to_point
from loopid.motion.trajectories import Arc

NAMES = ("x_m", "z_m", "theta")
RATE = 2000.0
START = np.array([0.1, 0.7, 0.0])
numbers = st.floats(-0.5, 0.5)
points = st.lists(numbers, min_size=3, max_size=3).map(np.array)
arcs = st.builds(Arc, st.sampled_from(NAMES), numbers, st.sampled_from([0.0, 0.3, 0.8]))
waypoints = st.builds(Waypoint, points, st.floats(0.5, 3.0), st.lists(arcs, max_size=2).map(tuple))


def assert_derivatives(motion):
    """Each array is the derivative of the one before, where the motion has no corner of jerk."""
    step = motion.time[1] - motion.time[0]
    for values, slopes in (
        (motion.position, motion.velocity),
        (motion.velocity, motion.acceleration),
    ):
        central = (values[2:] - values[:-2]) / (2 * step)
        bound = 2 * step * (1 + np.abs(np.diff(slopes, axis=0)).max() / step)
        assert np.abs(central - slopes[1:-1]).max() <= bound


@given(st.lists(waypoints, min_size=1, max_size=4))
def test_waypoints_are_reached_at_rest_and_smoothly(ways):
    motion = point_to_point(NAMES, START, ways, rate=RATE)
    assert_derivatives(motion)
    ends = np.cumsum([way.seconds for way in ways])
    assert motion.duration == pytest.approx(ends[-1], abs=1 / RATE)
    stops = [START, *(way.position for way in ways)]
    for end, stop in zip([0.0, *ends], stops, strict=True):
        nearest = int(np.abs(motion.time - end).argmin())
        # Within a sample of the end the motion has hardly begun: it starts with the third power.
        np.testing.assert_allclose(motion.position[nearest], stop, atol=1e-6)
        np.testing.assert_allclose(motion.velocity[nearest], 0, atol=1e-3)


def test_no_jump_in_velocity_or_acceleration_at_a_turn():
    ways = [Waypoint(START + 0.2, 1.0, (Arc("z_m", 0.05),)), Waypoint(START, 0.7)]
    jumps = []
    for rate in (1e3, 1e4):
        motion = point_to_point(NAMES, START, ways, rate=rate)
        jumps.append(np.abs(np.diff(motion.acceleration, axis=0)).max())
    # A continuous acceleration changes ten times less in a ten times shorter step.
    assert jumps[1] < 0.15 * jumps[0]


def test_the_same_place_again_is_a_hold():
    motion = point_to_point(NAMES, START, [Waypoint(START, 2.0)])
    np.testing.assert_array_equal(motion.position, np.tile(START, (len(motion), 1)))
    assert not motion.velocity.any()
    assert not motion.acceleration.any()


@pytest.mark.parametrize("flatness", [0.0, 0.5, 0.8])
def test_an_arc_is_highest_half_way_and_gone_at_the_ends(flatness):
    value, slope, _ = Arc("z_m", 0.04, flatness).detour(np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(value, [0, 0.04, 0], atol=1e-15)
    assert slope[1] == 0


def test_the_elliptic_arc_of_the_eighth_identification_trajectory():
    # z = 0.68 + 0.4 (sqrt(0.0625 - x²) - 0.15) while x goes from 0.2 to -0.2.
    x = 0.2 - 0.4 * np.linspace(0, 1, 50)
    value, _, _ = Arc("z_m", 0.04, 0.8).detour(np.linspace(0, 1, 50))
    np.testing.assert_allclose(value, 0.4 * (np.sqrt(0.0625 - x**2) - 0.15), atol=1e-15)


def fourier(harmonics=3):
    sine, cosine = np.random.default_rng(0).normal(size=(2, 3, harmonics))
    return FourierSeries(NAMES, 0.1, START, sine, cosine)


def test_fourier_series_repeat_and_their_derivatives_hold():
    series = fourier()
    once, twice = series.motion(rate=RATE), series.motion(2 * series.period, rate=RATE)
    assert_derivatives(once)
    for name in ("position", "velocity", "acceleration"):
        last, first = getattr(once, name)[-1], getattr(once, name)[0]
        np.testing.assert_allclose(last, first, atol=1e-9)
        np.testing.assert_allclose(
            getattr(twice, name)[len(once) :], getattr(once, name)[1:], atol=1e-9
        )


def test_the_mean_of_a_period_is_the_offset():
    motion = fourier().motion(rate=100.0)
    np.testing.assert_allclose(motion.position[:-1].mean(axis=0), START, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: point_to_point(NAMES, START, []), "waypoint"),
        (lambda: point_to_point(NAMES, START[:2], [Waypoint(START, 1.0)]), "shape"),
        (lambda: point_to_point(NAMES, START, [Waypoint(START * np.nan, 1.0)]), "finite"),
        (lambda: point_to_point(NAMES, START, [Waypoint(START, 1.0)], rate=-1.0), "rate must"),
        (lambda: point_to_point(NAMES, START, [Waypoint(START, 1, (Arc("psi", 1),))]), "psi"),
        (
            lambda: FourierSeries(NAMES, 1.0, START, np.ones((3, 2)), np.ones((3, 1))),
            "cosine must have shape",
        ),
        (lambda: FourierSeries(NAMES, 1.0, START, np.ones(3), np.ones(3)), "sine must have"),
        (lambda: JointMotion(1.0, *np.zeros((3, 1, 2)), [0.1]), "time must have shape"),
        (lambda: Motion(NAMES, np.array([0.0, 0.0]), *np.zeros((3, 2, 3))), "increase"),
        (lambda: Motion(NAMES, np.array([0.0, 1.0]), *np.zeros((3, 2, 2))), "position"),
    ],
)
def test_wrong_input_is_refused(make, word):
    with pytest.raises(DataError, match=word):
        make()


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (lambda: Waypoint(START, 0.0), "seconds"),
        (lambda: Arc("z_m", 0.1, 1.0), "flatness"),
        (lambda: FourierSeries(NAMES, 0.0, START, np.ones((3, 2)), np.ones((3, 2))), "frequency"),
    ],
)
def test_wrong_numbers_are_refused(make, argument):
    with pytest.raises(OptionError) as refusal:
        make()
    assert refusal.value.facts["argument"] == argument
