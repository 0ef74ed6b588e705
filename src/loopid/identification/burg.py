"""Burg's recursion: an autoregressive model of errors with gaps between them."""

from __future__ import annotations

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray
from loopid.identification.autoregression import raised

LARGEST_ORDER = 20
# Pairs of samples that each further coefficient must rest on.
PAIRS_PER_COEFFICIENT = 10
# White noise, as part of the variance, that errors count as if they had: models of errors that were
# filtered would otherwise spend their coefficients on frequencies where nothing is left.
WHITE_FLOOR = 0.001


def run_lengths(used: BoolArray, pieces: tuple[slice, ...]) -> IntArray:
    """For each sample (N,), how many used ones of its piece end with it without a break."""
    lengths = np.zeros(len(used), dtype=np.int64)
    for piece in pieces:
        place = np.arange(1, piece.stop - piece.start + 1)
        last_break = np.maximum.accumulate(np.where(used[piece], 0, place))
        lengths[piece] = place - last_break
    return lengths


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
    forward = np.where(runs > 0, errors, 0.0)
    backward, count = forward.copy(), int((runs > 0).sum())
    observed = float(forward @ forward) / count
    white = WHITE_FLOOR * observed
    polynomial, variance = np.ones(1), observed + white
    covariances, best, chosen = [variance], _bic(variance, 0, count), 1
    for k in range(1, LARGEST_ORDER + 1):
        rows = np.flatnonzero(runs > k)
        if len(rows) < PAIRS_PER_COEFFICIENT * k or not observed > 0:
            break
        ahead, behind, past = forward[rows], backward[rows - 1], polynomial[1:]
        common = ahead @ behind + len(rows) * white * (past @ past[::-1])
        energy = ahead @ ahead + behind @ behind + 2 * len(rows) * white * (polynomial @ polynomial)
        reflection = -2 * float(common / energy)
        covariances.append(-reflection * variance - float(past @ covariances[:0:-1]))
        forward[rows], backward[rows] = ahead + reflection * behind, behind + reflection * ahead
        polynomial, variance = raised(polynomial, reflection), variance * (1 - reflection**2)
        criterion = _bic(variance, k, count)
        if criterion < best:
            best, chosen = criterion, k + 1
    return np.array(covariances[:chosen]) / (1 + WHITE_FLOOR)


def _bic(variance: float, order: int, count: int) -> float:
    return count * float(np.log(variance)) + order * float(np.log(count)) if variance > 0 else 0.0
