"""One reproduction of the paper, to be reported."""

import pytest

from small_paper import small_paper


@pytest.fixture(scope="session")
def paper():
    return small_paper()
