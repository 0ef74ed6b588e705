"""Blocks of rows of any size, for all tests of this room."""

from block_sizes import set_block_rows

__all__ = ["set_block_rows"]
