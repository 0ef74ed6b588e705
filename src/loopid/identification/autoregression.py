"""Autoregressive processes: errors that remember the ones before them.

Models are fitted by Burg's method [Percival1993], which never predicts across gaps.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from loopid.arguments import BoolArray, FloatArray, IntArray, row_blocks
from loopid.errors import OptionError
from loopid.records import record

LARGEST_REFLECTION = 0.9999  # keeps models of very slow errors stationary


@record(kw_only=True, checked=True)
class CorrelationOptions:
    """How errors that are not independent are modelled.

    Attributes
    ----------
    largest_order : int
        Coefficients of an autoregressive model at most.
    pairs_per_coefficient : int
        Pairs of samples that each further coefficient must rest on.
    white_floor : float
        White noise, as part of the variance, that errors count as if they had: models of errors
        that were filtered would otherwise spend their coefficients on frequencies where nothing is
        left.
    corrections : int
        Rounds of adding back what a fit takes up of its errors: on slow errors each adds half as
        much as the one before.
    kept_innovation : float
        Part of the innovations' variance that a correction must leave.
    least_runs : int
        Fewest recordings whose scatter counts.
    clearly_fewer : float
        Effective samples, relative to all, below which a user is warned.
    false_alarm : float
        Probability that a user is warned of a scatter between recordings that is chance.

    Raises
    ------
    OptionError
        When a number is out of its range.
    """

    largest_order: int = 20
    pairs_per_coefficient: int = 10
    white_floor: float = 0.001
    corrections: int = 6
    kept_innovation: float = 0.5
    least_runs: int = 3
    clearly_fewer: float = 0.5
    false_alarm: float = 0.01

    def __post_init__(self) -> None:
        least = {"largest_order": 0, "pairs_per_coefficient": 1, "corrections": 0, "least_runs": 2}
        for name, value in least.items():
            if getattr(self, name) < value:
                raise OptionError(
                    f"{name} must be from {value} on, not {getattr(self, name)}", least=value
                )
        for name in ("white_floor", "kept_innovation", "clearly_fewer", "false_alarm"):
            if not 0 <= getattr(self, name) < 1:
                raise OptionError(
                    f"{name} must be from 0 on and below 1, not {getattr(self, name)}"
                )


@record
class Autoregression:
    """e_t = Σ c_k e_{t-k} + ε_t, with ε independent.

    Attributes
    ----------
    coefficients : FloatArray
        (p,), c_k.
    variance : float
        Of ε.
    """

    coefficients: FloatArray
    variance: float

    @classmethod
    def of_covariances(
        cls, covariances: FloatArray, largest_reflection: float = LARGEST_REFLECTION
    ) -> Autoregression:
        """The model with autocovariances (p + 1,) at lags 0 to p, by Levinson's recursion.

        No process has covariances that ask for a reflection coefficient of 1 or more; where they
        do, the model ends at that lag with the largest allowed.
        """
        polynomial, variance = np.ones(1), float(covariances[0])
        for k in range(1, len(covariances)):
            asked = -float(polynomial @ covariances[k:0:-1]) / variance
            reflection = float(np.clip(asked, -largest_reflection, largest_reflection))
            polynomial, variance = _raised(polynomial, reflection), variance * (1 - reflection**2)
            if reflection != asked:
                break
        return cls(-polynomial[1:], variance)

    @property
    def order(self) -> int:
        """Number p of coefficients."""
        return len(self.coefficients)

    @property
    def polynomial(self) -> FloatArray:
        """(p + 1,), A of A(z) e = ε: 1, then -c_k."""
        return np.append(1.0, -self.coefficients)

    @cached_property
    def covariances(self) -> FloatArray:
        """Autocovariances (p + 1,) at lags 0 to p, by the equations of Yule and Walker."""
        matrix, lags = np.zeros((self.order + 1, self.order + 1)), np.arange(self.order + 1)
        for j, a in enumerate(self.polynomial):
            np.add.at(matrix, (lags, np.abs(lags - j)), a)
        right = np.append(self.variance, np.zeros(self.order))
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)

    def past_part(
        self, rows: FloatArray, state: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Contribution of the rows X (L, m) up to each one to Ω X, and the state for the next rows.

        Ω is the covariance of evenly spaced errors, one a row. Autocovariances follow the recursion
        of the process, so a filter N / A with as many coefficients has them as its impulse
        response: Ω X is X filtered forwards and backwards in time, less γ_0 X, which both count.
        """
        # Slow to import, and only needed where errors are correlated.
        from scipy.signal import lfilter

        if state is None:
            state = np.zeros((self.order, rows.shape[1]))
        numerator = np.convolve(self.polynomial, self.covariances)[: max(self.order, 1)]
        past, state = lfilter(numerator, self.polynomial, rows, axis=0, zi=state)
        return np.asarray(past, dtype=np.float64), np.asarray(state, dtype=np.float64)

    def sum_variance(self, present: BoolArray, pieces: tuple[slice, ...]) -> float:
        """Variance of the sum of errors over the samples (N,) that are present.

        ``pieces`` are the rows of evenly sampled stretches; errors of different ones are
        independent.
        """
        ones = np.asarray(present, dtype=np.float64)[:, None]
        past = sum(float(np.vdot(ones[piece], self.past_part(ones[piece])[0])) for piece in pieces)
        return 2 * past - float(self.covariances[0]) * float(ones.sum())


def run_lengths(used: BoolArray, pieces: tuple[slice, ...]) -> IntArray:
    """Length of the unbroken run of used samples of its piece that ends with each sample (N,)."""
    places = np.arange(1, len(used) + 1)
    breaks = np.where(used, 0, places)
    for piece in pieces:
        breaks[piece] = np.maximum.accumulate(np.maximum(breaks[piece], piece.start))
    return places - breaks


def burg_covariances(
    errors: FloatArray, runs: IntArray, options: CorrelationOptions = CorrelationOptions()
) -> FloatArray:
    """Autocovariances (p + 1,) of a model of errors (N,), its order p chosen by BIC [Schwarz1978].

    Forward and backward predictions within unbroken runs only [Burg1975], so that gaps are never
    predicted across; ``runs`` (N,) are as of ``run_lengths``, 0 where a sample is not used. The
    errors count as if a little white noise had been added to them, by what it adds to the sums on
    average.
    """
    products, rows = _window_products(errors, runs, options.largest_order)
    observed = float(products[0, 0, 0] / rows[0])
    white = options.white_floor * observed
    polynomial, variance = np.ones(1), observed + white
    covariances, criteria = [variance], [0.0]
    for k in range(1, options.largest_order + 1):
        if rows[k] < options.pairs_per_coefficient * k or not observed > 0:
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
        polynomial, variance = _raised(polynomial, reflection), variance * (1 - reflection**2)
        criteria.append(rows[0] * np.log(variance / covariances[0]) + k * np.log(rows[0]))
    best = int(np.argmin(criteria))
    return np.array(covariances[: best + 1]) / (1 + options.white_floor)


def _window_products(errors: FloatArray, runs: IntArray, order: int) -> tuple[FloatArray, IntArray]:
    """For each k up to an order, Σ w wᵀ over the rows whose run is longer, and their number.

    w = (e_t, e_{t-1}, ...) up to that order, of which the first k + 1 are within the run. All that
    Burg's recursion adds up are quadratic forms of these sums, so one pass serves every order.
    """
    width = order + 1
    products, counts = np.zeros((width, width, width)), np.zeros(width, dtype=np.int64)
    for rows in row_blocks(len(errors)):
        first = max(rows.start - order, 0)
        missing = order - (rows.start - first)
        series = np.where(runs[first : rows.stop] > 0, errors[first : rows.stop], 0.0)
        windows = sliding_window_view(np.pad(series, (missing, 0)), width)[:, ::-1]
        reach = np.minimum(runs[rows], width)
        for length in np.unique(reach[reach > 0]):
            inside = windows[reach == length, :length]
            products[length - 1, :length, :length] += inside.T @ inside
            counts[length - 1] += len(inside)
    return np.cumsum(products[::-1], axis=0)[::-1], np.cumsum(counts[::-1])[::-1]


def _raised(polynomial: FloatArray, reflection: float) -> FloatArray:
    """The polynomial of one order more."""
    longer = np.append(polynomial, 0.0)
    return np.asarray(longer + reflection * longer[::-1], dtype=np.float64)
