"""Wrong commands are answered in one sentence; ``fuzz.py`` runs thousands of them."""

import warnings

import pytest
from fuzz import calls, fuzz, log_calls

MANY = [
    pytest.param(made, range(*numbers), marks=pytest.mark.validate)
    for made, numbers in ((calls, (10, 300)), (log_calls, (5, 60)))
]


@pytest.mark.parametrize(("made", "numbers"), [(calls, range(10)), (log_calls, range(5)), *MANY])
def test_commands_answer_or_refuse_in_one_sentence(tmp_path, made, numbers):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz(tmp_path, numbers, made=made) == {}
