"""Exact order statistics, against those of all values at once."""

import numpy as np
import pytest

from block_sizes import set_block_rows
from loopid import order_statistics
from loopid.order_statistics import largest, median, percentile

__all__ = ["set_block_rows"]

SERIES = {
    "normal": lambda rng, n: rng.normal(size=n),
    "few values": lambda rng, n: rng.integers(0, 5, n).astype(float),
    "one value": lambda rng, n: np.full(n, 3.0),
    "whole numbers": lambda rng, n: 10**7 + rng.integers(-9, 9, n),
    "many sizes": lambda rng, n: np.exp(30 * rng.normal(size=n)),
    "neighbours": lambda rng, n: np.where(rng.random(n) < 0.5, 1.0, np.nextafter(1.0, 2.0)),
}


@pytest.mark.parametrize("series", SERIES.values(), ids=SERIES)
@pytest.mark.parametrize("bins", [2, 5, 4096])
def test_they_are_those_of_all_values(series, bins, set_block_rows, monkeypatch):
    rng = np.random.default_rng(0)
    monkeypatch.setattr(order_statistics, "BINS", bins)
    for count in (1, 2, 3, 50, 331):
        x = series(rng, count)
        set_block_rows(int(rng.integers(1, 40)))
        for percent in (0.0, 37.3, 50.0, 99.0, 100.0):
            assert percentile(lambda r: x[r], count, percent) == np.percentile(x, percent)  # noqa: B023
        assert median(lambda r: x[r], count) == np.median(x)  # noqa: B023
        assert largest(lambda r: x[r], count) == x.max()  # noqa: B023
