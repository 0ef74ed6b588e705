"""Sums as they are printed."""

import pytest

from loopid.base_parameters import expression
from loopid.errors import OptionError

TERMS = {"arm.mx": 1.0, "hand.m": -0.312345, "ball.m": -1.0}


@pytest.mark.parametrize(
    ("terms", "digits", "text"),
    [
        (TERMS, 4, "arm.mx - 0.3123 hand.m - ball.m"),
        (TERMS, 2, "arm.mx - 0.31 hand.m - ball.m"),
        ({"arm.mx": -1.0, "hand.m": 2e-7}, 4, "-arm.mx + 2e-07 hand.m"),
        ({"arm.mx": -0.5}, 4, "-0.5 arm.mx"),
        ({}, 4, ""),
    ],
)
def test_terms_read_as_a_sum(terms, digits, text):
    assert expression(terms, digits) == text


def test_a_sum_has_digits():
    with pytest.raises(OptionError) as refused:
        expression(TERMS, 0)
    assert refused.value.facts == {"argument": "digits", "given": 0}
