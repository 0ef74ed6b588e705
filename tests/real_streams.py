"""The real robots' logs, read without loopid."""

import gzip

import numpy as np


def read_stream(file):
    """Stamps (N,) in ns and values (N, 4) of one stream."""
    with gzip.open(file, "rt") as lines:
        table = np.loadtxt(lines, skiprows=1)
    return table[:, 0].astype(np.int64) * 10**9 + table[:, 1].astype(np.int64), table[:, 2:]
