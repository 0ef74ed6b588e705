"""Sums as they are printed, with and without the names of their coefficients."""

import pytest

from loopid.base_parameters import (
    CoefficientName,
    equations,
    expression,
)
from loopid.base_parameters.naming import FORMS
from loopid.parameters import NamedLength

X = NamedLength("x(tip)", -0.3, "x of tip in arm")
Y = NamedLength("y(tip)", 0.2, "y of tip in arm")
TERMS = {"arm.mx": 1.0, "hand.m": -0.3, "ball.m": 0.06}


def name(power, text, *lengths, negated=False):
    (form,) = [form for form in FORMS[len(lengths)][power] if form.text == text]
    return CoefficientName(form, lengths, negated)


def test_without_names_it_is_a_sum_of_numbers():
    assert expression(TERMS) == expression(TERMS, names={}) == "arm.mx - 0.3 hand.m + 0.06 ball.m"


def test_names_follow_the_sum():
    names = {"hand.m": name(1, "{0}", X)}
    assert expression(TERMS, names=names) == f"{expression(TERMS)}, where -0.3 = x(tip)"


def test_digits_are_those_of_both_parts():
    names = {"b.m": name(1, "{0}", NamedLength("x(b)", 0.123456, ""))}
    assert expression({"a.mx": 1.0, "b.m": 0.123456}, 2, names) == (
        "a.mx + 0.12 b.m, where 0.12 = x(b)"
    )


def test_a_minus_is_left_to_the_sum():
    product = name(2, "{0} {1}", X, Y, negated=True)
    assert product.text == "-x(tip) y(tip)"
    assert equations({"arm.Ixy": 1.0, "hand.m": 0.06}, {"hand.m": product}) == [
        "-0.06 = x(tip) y(tip)"
    ]


def test_equal_terms_are_explained_once():
    terms, names = {"a.m": 0.2, "b.m": 0.2}, dict.fromkeys(("a.m", "b.m"), name(1, "{0}", Y))
    assert equations(terms, names) == ["0.2 = y(tip)"]


@pytest.mark.parametrize("together", FORMS)
@pytest.mark.parametrize("negated", [False, True])
def test_every_form_reads_as_the_number_it_makes(together, negated, evaluate):
    for forms in FORMS[together].values():
        for form in forms:
            made = CoefficientName(form, (X, Y)[:together], negated)
            value = form.value(X.value, Y.value) * (-1 if negated else 1)
            assert evaluate(made) == pytest.approx(value, rel=1e-12)
            number, _, text = made.equation(value, digits=17).partition(" = ")
            unsigned = CoefficientName(form, made.lengths, negated=False)
            assert text == unsigned.text
            assert float(number) == pytest.approx(evaluate(unsigned), rel=1e-12)


@pytest.mark.parametrize("together", FORMS)
def test_every_form_has_its_power_of_length(together):
    for power, forms in FORMS[together].items():
        for form in forms:
            scaled = form.value(3 * X.value, 3 * Y.value)
            assert scaled == pytest.approx(3.0**power * form.value(X.value, Y.value), rel=1e-12)
