"""A set of base parameters says the same in numbers, terms and text, and cannot be changed."""

import pickle
import re
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from choice_problems import parameters
from hypothesis import given, strategies as st

from loopid.base_parameters import expression, find_base
from loopid.errors import DataError, OptionError
from loopid.observation import Observation

TERM = re.compile(r"(?P<sign>[+-]?) ?(?:(?P<size>[\d.]+(?:e[+-]\d+)?) )?(?P<label>[A-Za-z_]\S*)")


def parse(text):
    """Read an expression back: label to coefficient."""
    terms = {}
    for match in TERM.finditer(text):
        size = float(match["size"] or 1.0)
        terms[match["label"]] = -size if match["sign"] == "-" else size
    assert " ".join(match[0].strip() for match in TERM.finditer(text)) == text
    return terms


def make(seed=0, n=9, r=4):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(r, n))
    rows[:, 3] = 0.0
    rows[:, 5] = -rows[:, 0]
    return find_base(Observation.from_matrix(rng.normal(size=(20, r)) @ rows, parameters(n)))


@pytest.fixture(scope="module")
def found():
    return make()


@given(st.integers(0, 1000), st.integers(7, 15), st.integers(2, 5))
def test_matrix_terms_names_and_values_agree(seed, n, r):
    found = make(seed, n, r)
    labels = found.parameters.labels
    assert found.names == tuple(labels[j] for j in found.base)
    assert len(found) == len(found.terms) == len(found.expressions) == r
    for i, terms in enumerate(found.terms):
        assert next(iter(terms.items())) == (found.names[i], 1.0)
        row = np.zeros(len(labels))
        row[[labels.index(label) for label in terms]] = list(terms.values())
        np.testing.assert_array_equal(row, found.matrix[i])
        assert all(terms.values())
    phi = np.random.default_rng(seed).normal(size=n)
    expected = [sum(c * phi[labels.index(k)] for k, c in terms.items()) for terms in found.terms]
    np.testing.assert_allclose(found.values(phi), expected, rtol=1e-12)


@given(st.integers(0, 1000))
def test_every_column_is_base_dependent_or_without_effect(seed):
    found = make(seed)
    with_effect = sorted([*found.base, *found.dependent])
    assert with_effect == found.structure.columns.tolist()
    assert 3 not in with_effect
    assert not found.matrix[:, 3].any()
    np.testing.assert_array_equal(found.matrix[:, found.base], np.eye(len(found)))
    np.testing.assert_array_equal(found.matrix[:, found.dependent], found.regrouping)


@given(st.integers(0, 1000))
def test_expressions_read_back_to_the_displayed_digits(seed):
    found = make(seed)
    for text, terms in zip(found.expressions, found.terms, strict=True):
        assert parse(text) == pytest.approx(terms, rel=0.5001 * 10 ** (1 - 4))
        assert list(parse(text)) == list(terms)


def test_round_off_decides_no_digit():
    ties = (0.21735 * (1 + k * 1e-14) for k in (-1, 0, 1))
    assert len({expression({"link2.m": tie}) for tie in ties}) == 1


COEFFICIENTS = st.floats(-1e9, 1e9).filter(lambda x: abs(x) > 1e-9)
LABELS = [f"link_{i}.part.mx" for i in range(6)]


@given(st.lists(COEFFICIENTS, min_size=1, max_size=6), st.integers(1, 12))
def test_any_sum_reads_back(coefficients, digits):
    terms = dict(zip(LABELS, coefficients, strict=False))
    text = expression(terms, digits)
    assert parse(text) == pytest.approx(terms, rel=0.5001 * 10 ** (1 - digits))


def test_ones_are_not_written():
    assert expression({"a.m": 1.0, "b.m": -1.0, "c.m": 1.00000001}) == "a.m - b.m + c.m"
    assert expression({"a.m": -1.0, "b.m": 0.25}) == "-a.m + 0.25 b.m"


def test_a_base_parameter_by_its_name(found):
    for name, terms, text in zip(found, found.terms, found.expressions, strict=True):
        assert name in found
        one = found[name]
        assert (one, expression(one)) == (dict(terms), text)
        assert next(iter(one.items())) == (name, 1.0)
    dependent = found.parameters.labels[found.dependent[0]]
    assert dependent not in found
    for wrong in (dependent, "m", 0, None):
        with pytest.raises(OptionError) as refused:
            found[wrong]
        assert refused.value.facts == {"given": wrong, "valid": found.names}


def test_equal_observations_have_equal_base_parameters(found):
    again = make()
    assert found == again == pickle.loads(pickle.dumps(found))
    assert hash(found) == hash(again)
    assert found != make(1)
    assert len(repr(found).splitlines()) <= 10


def test_nothing_can_be_changed(found):
    arrays = [found.base, found.dependent, found.regrouping, found.matrix]
    structure = found.structure
    arrays += [structure.columns, structure.singular_values, structure.null_basis]
    for array in [*arrays, structure.row_factor]:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    with pytest.raises(TypeError):
        found.terms[0]["more"] = 1.0
    with pytest.raises(FrozenInstanceError):
        found.base = found.dependent
    with pytest.raises(FrozenInstanceError):
        found.search.certified = False


@pytest.mark.parametrize("shape", [(8,), (10,), (9, 1), (1, 9), ()])
def test_values_of_another_shape_are_refused(found, shape):
    with pytest.raises(DataError, match=re.escape(f"must have shape (9,), not {shape}")):
        found.values(np.ones(shape))


@pytest.mark.parametrize("shape", [(4, 8), (9, 4), (3,), ()])
@pytest.mark.parametrize("method", ["regressor", "reconstruction_error"])
def test_regressors_of_another_width_are_refused(found, method, shape):
    with pytest.raises(DataError, match="must have 9 columns"):
        getattr(found, method)(np.ones(shape))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused_with_their_place(found, bad):
    phi, W = np.ones(9), np.ones((2, 9))
    phi[4] = W[1, 7] = bad
    with pytest.raises(DataError, match=r"standard parameters must be finite, but entry \(4,\)"):
        found.values(phi)
    for method in (found.regressor, found.reconstruction_error):
        with pytest.raises(DataError, match=r"regressor must be finite, but entry \(1, 7\)"):
            method(W)
