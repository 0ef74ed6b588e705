"""Stacks of symmetric matrices and their order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid.base_parameters.search.loewner import (
    eliminate,
    groups,
    maximal,
    positive_definite,
    upper_bounds,
)


@st.composite
def stacks(draw, most=12):
    count, kinds, width = (
        draw(st.integers(1, most)),
        draw(st.integers(1, 2)),
        draw(st.integers(1, 4)),
    )
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    # Whole numbers: equal forms and exact comparisons occur.
    forms = rng.integers(-2, 3, size=(count, kinds, width, width)).astype(float)
    return (forms + forms.swapaxes(2, 3)) / 2


def exceeds(a, b, slack=1e-9):
    return (np.linalg.eigvalsh(a - b) >= -slack).all()


@given(forms=stacks())
def test_positive_definite_is_what_eigenvalues_say(forms):
    values = np.linalg.eigvalsh(forms).reshape(len(forms), -1)
    expected = (values > 1e-9).all(axis=1)
    np.testing.assert_array_equal(positive_definite(forms), expected)


@given(forms=stacks(), data=st.data())
def test_elimination_minimises_over_the_last_coordinates(forms, data):
    width = forms.shape[-1]
    count = data.draw(st.integers(0, width))
    forms = forms + 5 * np.eye(width) * data.draw(st.sampled_from([0, 1]))
    reduced, kept = eliminate(forms, count)
    last = forms[..., width - count :, width - count :]
    np.testing.assert_array_equal(kept, np.flatnonzero(positive_definite(last)))
    y = np.arange(1.0, width - count + 1)
    for form, schur in zip(forms[kept], reduced, strict=True):
        for matrix, small in zip(form, schur, strict=True):
            A, B = (
                matrix[: width - count, : width - count],
                matrix[: width - count, width - count :],
            )
            z = -np.linalg.solve(matrix[width - count :, width - count :], B.T @ y)
            value = y @ A @ y + 2 * y @ B @ z + z @ matrix[width - count :, width - count :] @ z
            assert y @ small @ y == pytest.approx(value, abs=1e-9)


@given(forms=stacks(most=90))
def test_maximal_forms_exceed_all_others_and_not_each_other(forms):
    kept = maximal(forms)
    assert all(any(exceeds(forms[k], form) for k in kept) for form in forms)
    assert not any(exceeds(forms[a], forms[b], -1e-6) for a in kept for b in kept if a != b)
    assert len(np.unique(forms[kept].reshape(len(kept), -1), axis=0)) == len(kept)


@given(forms=stacks(), data=st.data())
def test_upper_bounds_exceed_all_of_their_group(forms, data):
    labels = np.array(
        data.draw(st.lists(st.integers(0, 3), min_size=len(forms), max_size=len(forms)))
    )
    bounds = upper_bounds(forms, labels)
    for label, bound in zip(np.unique(labels), bounds, strict=True):
        own = forms[labels == label]
        assert all(exceeds(bound, form) for form in own)
        if len(own) == 1:
            np.testing.assert_array_equal(bound, own[0])


@given(forms=stacks(), count=st.integers(1, 5))
def test_groups_are_few_and_hold_equal_forms_together(forms, count):
    labels = groups(forms, count)
    assert labels.max() < count
    for a, b in zip(*np.triu_indices(len(forms)), strict=True):
        if (forms[a] == forms[b]).all():
            assert labels[a] == labels[b]
