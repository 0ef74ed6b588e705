"""Wrong commands are answered in one sentence; ``fuzz.py`` runs thousands of them."""

import warnings

import pytest
from fuzz import calls, fuzz, log_calls


@pytest.mark.parametrize(("made", "count"), [(calls, 60), (log_calls, 12)])
def test_commands_answer_or_refuse_in_one_sentence(tmp_path, made, count):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz(tmp_path, range(count), made=made) == {}
