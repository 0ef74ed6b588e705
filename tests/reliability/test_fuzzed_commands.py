"""Wrong commands are answered in one sentence; ``fuzz.py`` runs thousands of them."""

import warnings

from fuzz import fuzz
from table import PAGE, page_with, table

CALLS = 60


def test_commands_answer_or_refuse_in_one_sentence(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz(tmp_path, range(CALLS)) == {}


def test_the_page_on_reliability_shows_what_is_answered(tmp_path):
    page = PAGE.read_text()
    assert page_with(table(tmp_path), page) == page
