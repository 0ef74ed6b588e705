"""Wrong commands are answered in one sentence; ``fuzz.py`` runs thousands of them."""

import warnings

from fuzz import fuzz

CALLS = 60


def test_commands_answer_or_refuse_in_one_sentence(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz(tmp_path, range(CALLS)) == {}
