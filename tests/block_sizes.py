"""Rows in memory at a time, as a test asks for: what comes out must not depend on them."""

import pytest

import loopid.arguments
import loopid.files


@pytest.fixture
def set_block_rows(monkeypatch):
    """Set how many rows a block has, and keep nothing larger in memory."""

    def set_them(rows):
        monkeypatch.setattr(loopid.arguments, "BLOCK_ROWS", rows)
        monkeypatch.setattr(loopid.files, "BLOCK_BYTES", 100 * rows)

    return set_them
