"""Fuzzed command lines keep their promises; ``fuzz.py`` runs thousands of them."""

import warnings

import pytest
from fuzz import fuzz

CALLS, PARTS = 150, 2


@pytest.mark.parametrize("part", range(PARTS))
def test_commands_answer_or_refuse_in_one_sentence(tmp_path, part):
    share = CALLS // PARTS
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz(tmp_path, range(part * share, (part + 1) * share)) == {}
