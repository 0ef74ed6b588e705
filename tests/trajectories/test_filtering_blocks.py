"""Filtering block by block gives every bit of filtering at once."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from block_sizes import set_block_rows
from loopid import LowPass

__all__ = ["set_block_rows"]


@pytest.mark.parametrize("size", [1, 7, 100, 10_000])
@pytest.mark.parametrize("order", [1, 2, 5])
@pytest.mark.parametrize("shape", [(500,), (500, 4), (500, 2, 3)])
def test_blocks_take_over_the_state_of_the_filter(set_block_rows, size, order, shape):
    signal = np.random.default_rng(0).normal(size=shape).cumsum(axis=0)
    filtering, rate = LowPass(6.0, order), 100.0
    sections = butter(order, 6.0, fs=rate, output="sos")
    padding = filtering.least_samples(rate) - 1
    expected = sosfiltfilt(sections, signal, axis=0, padlen=padding)
    set_block_rows(size)
    np.testing.assert_array_equal(filtering.apply(signal, rate), expected)
