"""Arrays that lie in files behave as those in memory, and leave the memory."""

import mmap
import subprocess
import sys

import numpy as np
import pytest

from loopid import scratch
from loopid.arguments import (
    finite,
    frozen,
    samples,
)
from loopid.errors import DataError
from loopid.scratch import (
    row_blocks,
    spooled,
)

TYPES = (np.float64, np.int64, np.bool_)


def in_file(array, rows=7):
    """The array, spooled in blocks, with one of no rows among them."""
    blocks = [array[r] for r in row_blocks(len(array), rows)]
    return spooled([array[:0], *blocks])


@pytest.fixture(params=[0, 2**20], ids=["in a file", "in memory"])
def spooled_bytes(request, monkeypatch):
    monkeypatch.setattr(scratch, "SPOOLED_BYTES", request.param)
    return request.param


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("shape", [(50,), (50, 3), (1, 2, 4)])
def test_a_spooled_array_is_its_blocks_in_a_row(spooled_bytes, dtype, shape):
    array = np.random.default_rng(0).normal(size=shape).astype(dtype)
    found = in_file(array)
    assert found.dtype == array.dtype
    assert not found.flags.writeable
    np.testing.assert_array_equal(found, array)
    np.testing.assert_array_equal(found[::-1], array[::-1])


def test_what_lies_in_a_file_is_kept_without_a_copy(monkeypatch):
    monkeypatch.setattr(scratch, "SPOOLED_BYTES", 0)
    array = in_file(np.arange(20.0).reshape(10, 2))
    for view in (array, array[2:5], array[::-1], array[:, 1]):
        assert np.shares_memory(frozen(view), view)
    assert not np.shares_memory(frozen(array, np.int64), array)
    mine = np.arange(3.0)
    copy = frozen(mine)
    mine[0] = 7.0
    assert copy[0] == 0.0
    assert not copy.flags.writeable


def test_numbers_that_are_none_are_named_wherever_they_lie(monkeypatch):
    monkeypatch.setattr(scratch, "SPOOLED_BYTES", 0)
    monkeypatch.setattr(scratch, "BLOCK_ROWS", 4)
    array = np.zeros((20, 2))
    array[13, 1] = np.nan
    for given in (array, in_file(array)):
        with pytest.raises(DataError, match=r"force must be finite, but entry \(13, 1\) is nan"):
            finite(given, "force")


def test_rows_of_another_number_or_width_are_refused(monkeypatch):
    monkeypatch.setattr(scratch, "SPOOLED_BYTES", 0)
    array = in_file(np.zeros((20, 2)))
    assert samples(array, 2, "force", 20) is array
    with pytest.raises(DataError, match=r"force must have shape \(samples, 3\)"):
        samples(array, 3, "force", 20)
    with pytest.raises(DataError, match="force must have 21 rows"):
        samples(array, 2, "force", 21)


GROWING = """
import numpy as np
from pathlib import Path
from loopid.scratch import row_blocks, spooled

def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))

before = peak()
array = spooled(np.full((4096, 8), float(k)) for k in range(400))
assert sum(array[rows].sum() for rows in row_blocks(len(array))) == 4096 * 8 * 399 * 200
print(peak() - before, array.nbytes // 1024)
"""


@pytest.mark.skipif(
    not hasattr(mmap, "MADV_DONTNEED") or sys.platform != "linux", reason="pages of Linux"
)
def test_a_large_array_is_read_in_a_small_memory():
    command = [sys.executable, "-c", GROWING]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    grown, size = map(int, output.split())
    assert size > 100_000
    assert grown < size / 5


def test_files_are_closed_when_their_arrays_are_gone(monkeypatch):
    monkeypatch.setattr(scratch, "SPOOLED_BYTES", 0)
    arrays = [in_file(np.zeros(10)) for _ in range(20)]
    count = len(scratch._mappings)
    assert count >= 20
    del arrays
    assert len(scratch._mappings) <= count - 20
