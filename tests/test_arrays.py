"""Arrays of public functions: real, finite numbers, taken as they are."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from loopid.arguments import LARGEST, finite
from loopid.errors import DataError

SIZES = st.floats(-LARGEST, LARGEST)


@given(arrays(np.float64, array_shapes(max_dims=3, max_side=4), elements=SIZES))
def test_numbers_are_taken_as_they_are(values):
    for same in (values, values.tolist(), values.astype(object), np.asfortranarray(values)):
        np.testing.assert_array_equal(finite(same, "values"), values)


@given(arrays(np.float32, 3, elements=st.floats(-(2.0**100), 2.0**100, width=32)))
def test_single_precision_is_read_as_the_numbers_it_holds(values):
    np.testing.assert_array_equal(finite(values, "values"), values.astype(np.float64))


@given(
    arrays(np.float64, st.integers(1, 6), elements=SIZES),
    st.integers(0, 5),
    st.sampled_from([np.nan, np.inf, -np.inf, 1e101, -1e300]),
)
def test_a_number_out_of_range_is_named(values, place, wrong):
    values[place % len(values)] = wrong
    with pytest.raises(DataError, match=rf"entry \({place % len(values)},\) is"):
        finite(values, "values")


@pytest.mark.parametrize(
    "wrong",
    [
        *(["1"], [1j], [None], [[1], [1, 2]], [10**400], np.array(["2020"], "M8[D]"), [b"1"]),
        *([True], [1.0, True, None], np.array([True, False])),
    ],
)
def test_what_numpy_would_read_as_numbers_is_refused(wrong):
    with pytest.raises(DataError, match=r"^values must be"):
        finite(wrong, "values")
