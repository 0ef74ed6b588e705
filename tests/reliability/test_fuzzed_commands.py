"""Wrong commands are answered in one sentence; ``fuzz.py`` runs thousands of them."""

import warnings

import pytest
from fuzz import fuzz


@pytest.mark.parametrize(
    "numbers",
    [range(20), pytest.param(range(20, 300), marks=pytest.mark.validate)],
    ids=["some", "more"],
)
def test_commands_answer_or_refuse_in_one_sentence(tmp_path, numbers):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz(tmp_path, numbers) == {}
