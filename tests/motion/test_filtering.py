"""Zero-phase filtering and differentiation: what must pass, what must not, and no delay."""

import numpy as np
import pytest
import scipy
from hypothesis import given, strategies as st
from scipy.fft import next_fast_len

from loopid.errors import DataError, OptionError
from loopid.motion import LowPass, filtering
from loopid.motion.filtering import differentiate, fast_length

RATE = 100.0
filters = st.builds(LowPass, st.floats(1, 20), st.integers(1, 4))
signals = st.integers(0, 2**32 - 1).map(
    lambda seed: np.random.default_rng(seed).normal(size=(1500, 2)).cumsum(axis=0)
)


@given(filters, st.floats(-5, 5), st.floats(-5, 5))
def test_straight_lines_pass_unchanged(lowpass, height, slope):
    line = height + slope * np.arange(1000) / RATE
    np.testing.assert_allclose(lowpass.apply(line, RATE), line, atol=1e-12 * (1 + abs(slope)))


@given(filters, signals)
def test_scipy_filters_alike(lowpass, signal):
    sections = scipy.signal.butter(lowpass.order, lowpass.cutoff, fs=RATE, output="sos")
    padding = lowpass.least_samples(RATE) - 1
    expected = scipy.signal.sosfiltfilt(sections, signal, axis=0, padlen=padding)
    found = lowpass.apply(signal, RATE)
    largest = np.abs(signal).max()
    # SciPy's passes start as if the signal had stood still: a millionth is left at the ends.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * largest)
    inside = slice(padding, -padding)
    np.testing.assert_allclose(found[inside], expected[inside], rtol=0, atol=1e-10 * largest)


@given(st.integers(1, 10**7))
def test_lengths_of_transforms_are_those_of_scipy(count):
    assert fast_length(count) == next_fast_len(count, real=True)


@given(filters, signals)
def test_columns_are_filtered_alike_alone_or_together(lowpass, signal):
    alone = [lowpass.apply(column, RATE) for column in signal.T]
    np.testing.assert_array_equal(lowpass.apply(signal, RATE), np.stack(alone, axis=1))


def test_many_columns_are_filtered_in_parts(monkeypatch):
    signal, lowpass = np.random.default_rng(0).normal(size=(200, 5)), LowPass(5.0)
    whole = lowpass.apply(signal, RATE)
    monkeypatch.setattr(filtering, "AT_ONCE", 600)  # of two columns
    np.testing.assert_array_equal(lowpass.apply(signal, RATE), whole)


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("ratio", [0.25, 1.0, 3.0])
def test_a_sine_is_damped_as_the_two_passes_say_and_not_delayed(order, ratio):
    lowpass = LowPass(2.0, order)
    time = np.arange(6000) / RATE
    sine = np.sin(2 * np.pi * ratio * 2.0 * time)
    middle = slice(2000, 4000)
    # The bilinear transform bends frequencies: both are measured on the bent axis.
    bent = np.tan(np.pi * ratio * 2.0 / RATE) / np.tan(np.pi * 2.0 / RATE)
    expected = sine / (1 + bent ** (2 * order))
    np.testing.assert_allclose(lowpass.apply(sine, RATE)[middle], expected[middle], atol=1e-6)


@given(filters, signals)
def test_time_has_no_direction(lowpass, signal):
    there, back = lowpass.apply(signal, RATE), lowpass.apply(signal[::-1], RATE)[::-1]
    np.testing.assert_allclose(there, back, atol=1e-12 * np.abs(signal).max())


@given(filters, signals, signals, st.floats(-3, 3))
def test_filtering_is_linear_and_columns_are_alone(lowpass, one, other, factor):
    together = lowpass.apply(one + factor * other, RATE)
    apart = lowpass.apply(one, RATE) + factor * lowpass.apply(other, RATE)
    np.testing.assert_allclose(together, apart, atol=1e-9 * (1 + np.abs(apart).max()))
    np.testing.assert_allclose(lowpass.apply(one[:, 1], RATE), lowpass.apply(one, RATE)[:, 1])


@pytest.mark.parametrize("order", [1, 2, 5])
@pytest.mark.parametrize("cutoff", [0.5, 2.0, 30.0])
def test_the_least_number_of_samples_is_enough_and_one_less_is_not(cutoff, order):
    lowpass = LowPass(cutoff, order)
    least = lowpass.least_samples(RATE)
    assert len(lowpass.apply(np.ones((least, 2)), RATE)) == least
    with pytest.raises(DataError, match=f"{least - 1} samples .* {least} at 100 Hz"):
        lowpass.apply(np.ones((least - 1, 2)), RATE)


def test_fast_sines_are_differentiated_to_fourth_order():
    time, turn = np.arange(200) / RATE, 2 * np.pi * RATE / 10  # ten samples a period
    found = differentiate(np.sin(turn * time), RATE)[2:-2] / turn
    lost = (turn / RATE) ** 4 / 30
    np.testing.assert_allclose(found, (1 - lost) * np.cos(turn * time)[2:-2], atol=0.1 * lost)


def test_parabolas_are_differentiated_exactly_to_their_ends():
    time = np.arange(50) / RATE
    values = np.column_stack([3 + 2 * time - 5 * time**2, np.full(50, 7.0)])
    expected = np.column_stack([2 - 10 * time, np.zeros(50)])
    np.testing.assert_allclose(differentiate(values, RATE), expected, atol=1e-11)


@pytest.mark.parametrize(
    ("make", "error", "word"),
    [
        (lambda: LowPass(0.0), OptionError, "cutoff"),
        (lambda: LowPass(np.nan), OptionError, "nan"),
        (lambda: LowPass(1.0, 0), OptionError, "order"),
        (lambda: LowPass(50.0).apply(np.ones(1000), RATE), OptionError, "half the sample rate, 50"),
        (lambda: LowPass(1.0).apply([1.0, np.nan], RATE), DataError, "finite"),
        (lambda: differentiate([1.0, 2.0], RATE), DataError, "3"),
    ],
)
def test_wrong_input_is_refused(make, error, word):
    with pytest.raises(error, match=word):
        make()
