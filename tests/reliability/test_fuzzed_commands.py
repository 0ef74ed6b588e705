"""Wrong commands are answered in one sentence; ``fuzz.py`` runs thousands of them."""

import warnings

import pytest
from fuzz import calls, fuzz, log_calls
from table import PAGE, page_with, table


@pytest.mark.parametrize("made", [calls, log_calls], ids=["commands", "logs"])
def test_commands_answer_or_refuse_in_one_sentence(tmp_path, made):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz(tmp_path, range(60 if made is calls else 12), made=made) == {}


def test_the_page_on_reliability_shows_what_is_answered(tmp_path):
    page = PAGE.read_text()
    assert page_with(table(tmp_path), page) == page
