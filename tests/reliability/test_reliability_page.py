"""docs/reliability.md says what is tried and what is answered, as it is now."""

from reliability_table import PAGE, page_with, table


def test_the_table_is_up_to_date(tmp_path):
    page = PAGE.read_text()
    assert page_with(table(tmp_path), page) == page
