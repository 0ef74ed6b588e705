"""Burg's recursion: an autoregressive model of errors with gaps between them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.identification.autoregression import raised
from loopid.scratch import row_blocks, spooled

LARGEST_ORDER = 20
# Pairs of samples that each further coefficient must rest on.
PAIRS_PER_COEFFICIENT = 10
# White noise, as part of the variance, that errors count as if they had: models of errors that were
# filtered would otherwise spend their coefficients on frequencies where nothing is left.
WHITE_FLOOR = 0.001


def run_lengths(used: BoolArray, pieces: tuple[slice, ...]) -> IntArray:
    """For each sample (N,), how many used ones of its piece end with it without a break."""
    return spooled(run for piece in pieces for run in _runs(used, piece))


def _runs(used: BoolArray, piece: slice) -> Iterator[IntArray]:
    last = 0
    for rows in row_blocks(piece):
        place = np.arange(rows.start, rows.stop) - piece.start + 1
        breaks = np.maximum.accumulate(np.where(used[rows], last, place))
        last = int(breaks[-1])
        yield place - breaks


def burg_covariances(errors: FloatArray, runs: IntArray) -> FloatArray:
    """Autocovariances (p + 1,) of the model of errors (N,), its order p chosen by BIC.

    Forward and backward predictions within unbroken runs only [Burg1975], so that gaps are never
    predicted across. The errors count as if a little white noise had been added to them, by what
    it adds to the sums on average. BIC is [Schwarz1978]'s.

    Parameters
    ----------
    runs : IntArray
        (N,), as of ``run_lengths``; 0 where a sample is not used.
    """
    products, rows = _window_products(errors, runs)
    count, observed = int(rows[0]), float(products[0, 0, 0] / rows[0])
    white = WHITE_FLOOR * observed
    polynomial, variance = np.ones(1), observed + white
    covariances, best, chosen = [variance], _bic(variance, 0, count), 1
    for k in range(1, LARGEST_ORDER + 1):
        if rows[k] < PAIRS_PER_COEFFICIENT * k or not observed > 0:
            break
        window, past = products[k, : k + 1, : k + 1], polynomial[1:]
        # Of e_t to e_{t-k}: e_t less its forward prediction, e_{t-k} less its backward one.
        ahead = np.append(polynomial, 0.0)
        behind = ahead[::-1]
        common = ahead @ window @ behind + rows[k] * white * (past @ past[::-1])
        energy = ahead @ window @ ahead + behind @ window @ behind
        energy += 2 * rows[k] * white * (polynomial @ polynomial)
        reflection = -2 * float(common / energy)
        covariances.append(-reflection * variance - float(past @ covariances[:0:-1]))
        polynomial, variance = raised(polynomial, reflection), variance * (1 - reflection**2)
        criterion = _bic(variance, k, count)
        if criterion < best:
            best, chosen = criterion, k + 1
    return np.array(covariances[:chosen]) / (1 + WHITE_FLOOR)


def _window_products(errors: FloatArray, runs: IntArray) -> tuple[FloatArray, IntArray]:
    """For each k to the largest order, Σ w wᵀ over the rows whose run is longer, and their number.

    w = (e_t, e_{t-1}, ...) up to that order, of which the first k + 1 are within the run. All that
    Burg's recursion adds up are quadratic forms of these sums, so one pass serves every order.
    """
    width = LARGEST_ORDER + 1
    products, counts = np.zeros((width, width, width)), np.zeros(width, dtype=np.int64)
    for rows in row_blocks(len(errors)):
        first = max(rows.start - LARGEST_ORDER, 0)
        missing = LARGEST_ORDER - (rows.start - first)
        series = np.where(runs[first : rows.stop] > 0, errors[first : rows.stop], 0.0)
        windows = sliding_window_view(np.pad(series, (missing, 0)), width)[:, ::-1]
        reach = np.minimum(runs[rows], width)
        for length in np.unique(reach[reach > 0]):
            inside = windows[reach == length, :length]
            products[length - 1, :length, :length] += inside.T @ inside
            counts[length - 1] += len(inside)
    return np.cumsum(products[::-1], axis=0)[::-1], np.cumsum(counts[::-1])[::-1]


def _bic(variance: float, order: int, count: int) -> float:
    return count * float(np.log(variance)) + order * float(np.log(count)) if variance > 0 else 0.0
