"""Covariances of estimates whose errors are correlated from one time to the next.

Errors of each actuator are an autoregressive process, fitted by Burg's method [Percival1993], which
never predicts across gaps. Residuals are smaller, and less autocorrelated, than the errors are: a
fit takes up whatever of the errors its regressor can express. This has a known expectation and is
added back [Worsley2002]. Else intervals are too narrow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtbtrs

from loopid.arguments import BoolArray, FloatArray, IntArray
from loopid.identification.estimator import WorkingFit
from loopid.identification.problem import FitProblem, FitSamples
from loopid.identification.quality import NoiseModel
from loopid.motion.filtering import fast_length
from loopid.numbers import FIT_ROUND_OFF
from loopid.records import record
from loopid.workers import one_blas_thread

LARGEST_REFLECTION = 0.9999  # keeps models of very slow errors stationary
LARGEST_ORDER = 20  # coefficients of a model at most
PAIRS = 10  # of samples that each further coefficient must rest on
# White noise, as part of the variance, that errors count as if they had: models of errors that were
# filtered would otherwise spend their coefficients on frequencies where nothing is left.
WHITE = 0.001
# Rounds of adding back what a fit takes up of its errors: on slow errors each adds half as much as
# the one before. Parts of a correction that are tried, until one leaves enough of the innovations'
# variance. Part of the variance that is no change.
CORRECTIONS, DAMPING, KEPT, SAME = 6, (1.0, 0.5, 0.25, 0.125, 0.0), 0.5, 1e-6
TINY = np.finfo(float).tiny

Pieces = tuple[slice, ...]  # rows of evenly sampled segments, whose errors are independent


@record
class Autoregression:
    """e_t = Σ c_k e_{t-k} + ε_t, with ε independent."""

    coefficients: FloatArray  # (p,), c_k
    variance: float  # of ε
    covariances: FloatArray  # (p + 1,), of e at lags 0 to p

    @classmethod
    def of_covariances(cls, covariances: FloatArray) -> Autoregression:
        """The model with autocovariances (p + 1,) at lags 0 to p, by Levinson's recursion.

        No process has covariances that ask for a reflection coefficient of 1 or more. Where they
        do, the model ends at that lag with the largest allowed.
        """
        polynomial, variance = np.append(1.0, np.zeros(len(covariances) - 1)), float(covariances[0])
        for k in range(1, len(covariances)):
            asked = -float(polynomial[:k] @ covariances[k:0:-1]) / variance
            reflection = min(max(asked, -LARGEST_REFLECTION), LARGEST_REFLECTION)
            polynomial[1 : k + 1] += reflection * polynomial[:k][::-1]
            if reflection != asked:
                covariances = np.append(covariances[:k], covariances[k])
                covariances[k] += (asked - reflection) * variance
                polynomial = polynomial[: k + 1]
            variance *= 1 - reflection**2
            if reflection != asked:
                break
        return cls(-polynomial[1:], variance, covariances)

    @classmethod
    def of_coefficients(cls, coefficients: FloatArray, variance: float) -> Autoregression:
        """The model with coefficients c_k (p,), by the equations of Yule and Walker."""
        lags = np.arange(len(coefficients) + 1)
        matrix = np.zeros((len(lags), len(lags)))
        for j, a in enumerate(np.append(1.0, -coefficients)):
            np.add.at(matrix, (lags, np.abs(lags - j)), a)
        covariances = np.linalg.solve(matrix, np.where(lags == 0, variance, 0.0))
        return cls(coefficients, variance, np.asarray(covariances, dtype=np.float64))

    @property
    def order(self) -> int:
        """Number p of coefficients."""
        return len(self.coefficients)

    @cached_property
    def polynomial(self) -> FloatArray:
        """(p + 1,), A of A(z) e = ε: 1, then -c_k."""
        return np.append(1.0, -self.coefficients)

    def lags(self, count: int) -> FloatArray:
        """Autocovariances (count,) from lag 0 on: they follow the recursion of the process."""
        bands = np.repeat(self.polynomial[:, None], count, axis=1)
        start = np.convolve(self.polynomial, self.covariances)[: min(self.order + 1, count)]
        right = np.append(start, np.zeros(count - len(start)))
        found, _ = dtbtrs(bands, right[:, None], uplo="L", diag="U")
        return np.asarray(found[:, 0])

    def sum_variance(self, pairs: FloatArray) -> float:
        """Variance of the sum of errors, of which there are so many ``pairs_apart`` (K,)."""
        return float(self.lags(len(pairs)) @ pairs)

    def covariance_of(self, signals: FloatArray, pieces: Pieces) -> FloatArray:
        """X Ω Xᵀ (m, m) of signals X (m, N), with Ω the covariance of the errors."""
        spectra = Spectra.of(signals, pieces)
        return spectra.covariance(spectra.densities(self))

    def effective_samples(self, present: BoolArray, pieces: Pieces) -> float:
        """Number of independent samples that would determine the mean error as well."""
        count = float(present.sum())
        spread = self.sum_variance(pairs_apart(present, pieces)) if self.order else 0.0
        return min(count**2 * float(self.covariances[0]) / spread, count) if spread > 0 else count


class Spectra(NamedTuple):
    """Spectra of m signals (m, N), each of whose pieces is followed by as many zeros.

    Ω X of a stationary process is then a product of spectra [Golub2013, 4.8]. Made once, those of X
    serve any model.
    """

    pieces: Pieces
    sizes: tuple[int, ...]  # samples of each piece, the zeros included
    each: tuple[NDArray[np.complex128], ...]
    powers: tuple[FloatArray, ...]  # of all signals together

    @classmethod
    def of(cls, signals: FloatArray, pieces: Pieces) -> Spectra:
        """Of signals (m, N)."""
        sizes = tuple(fast_length(2 * (piece.stop - piece.start)) for piece in pieces)
        parts = zip(pieces, sizes, strict=True)
        each = tuple(np.fft.rfft(signals[:, piece], size) for piece, size in parts)
        powers = tuple((one.real**2 + one.imag**2).sum(axis=0) for one in each)
        return cls(pieces, sizes, each, powers)

    def densities(self, model: Autoregression) -> list[FloatArray]:
        """Spectra of a model for the lengths of the pieces."""
        found, longest = [], model.lags(max(piece.stop - piece.start for piece in self.pieces))
        for piece, size in zip(self.pieces, self.sizes, strict=True):
            lags = longest[: piece.stop - piece.start]
            even = np.concatenate([lags, np.zeros(size + 1 - 2 * len(lags)), lags[:0:-1]])
            found.append(np.fft.rfft(even).real)
        return found

    def turned(self, densities: Sequence[FloatArray]) -> FloatArray:
        """X Ω (m, N), with Ω the covariance of errors, independent from piece to piece."""
        turned = [
            np.fft.irfft(own * density, size)[:, : piece.stop - piece.start]
            for piece, size, own, density in zip(*self[:3], densities, strict=True)
        ]
        return np.concatenate(turned, axis=1)

    def shared(self, densities: Sequence[FloatArray], count: int) -> FloatArray:
        """Σ_t (X Ω)_t · x_{t+k} for k below a count, over all t, within pieces and beyond."""
        found = np.zeros(count)
        for size, power, density in zip(self.sizes, self.powers, densities, strict=True):
            found += np.fft.irfft(power * density, size)[:count]
        return found

    def covariance(self, densities: Sequence[FloatArray]) -> FloatArray:
        """X Ω Xᵀ (m, m), by Parseval's theorem, of ``densities`` of a model."""
        found = np.zeros(2 * self.each[0].shape[:1])
        for size, own, density in zip(self.sizes, self.each, densities, strict=True):
            twice = np.full(len(density), 2.0 / size)
            twice[[0, -1]] = 1.0 / size, (1.0 + size % 2) / size  # those without a mirror image
            parts = np.concatenate([own.real, own.imag], axis=1)
            found += (parts * np.tile(twice * density, 2)) @ parts.T
        return found


def pairs_apart(present: BoolArray, pieces: Pieces) -> FloatArray:
    """How many pairs of samples (N,) that are present are so many steps apart, both ways; (K,)."""
    found = np.zeros(max(piece.stop - piece.start for piece in pieces))
    spectra = Spectra.of(np.asarray(present[None], dtype=np.float64), pieces)
    for piece, size, power in zip(pieces, spectra.sizes, spectra.powers, strict=True):
        count = piece.stop - piece.start
        found[:count] += np.fft.irfft(power, size)[:count]
    found[1:] *= 2
    return found.round()


def means_of_series(
    series: FloatArray, counts: IntArray | BoolArray, pieces: Pieces
) -> tuple[FloatArray, FloatArray]:
    """Means (m,) of numbers, given as sums (m, N) of so many each, and their standard errors.

    Each series is an autoregressive process: times do not count as independent.
    """
    total, present = int(counts.sum()), np.asarray(counts > 0)
    means, runs = series.sum(axis=1) / total, run_lengths(present, pieces)
    pairs = pairs_apart(present, pieces)
    found = zip(*_burg(series - np.outer(means, counts), runs), strict=True)
    models = (Autoregression.of_covariances(own[: order + 1]) for own, order in found)
    variances = [model.sum_variance(pairs) for model in models]
    return means, np.sqrt(variances) / total


def run_lengths(used: BoolArray, pieces: Pieces) -> IntArray:
    """Length of the unbroken run of used samples of its piece that ends with each sample (N,)."""
    places = np.arange(1, len(used) + 1)
    breaks = np.where(used, 0, places)
    for piece in pieces:
        breaks[piece] = np.maximum.accumulate(np.maximum(breaks[piece], piece.start))
    return places - breaks


def burg_covariances(errors: FloatArray, runs: IntArray) -> FloatArray:
    """Autocovariances (p + 1,) of a model of errors (N,), its order p chosen by BIC [Schwarz1978].

    By forward and backward predictions within unbroken ``runs`` (N,) only [Burg1975], as of
    ``run_lengths``. The errors count as if a little white noise had been added to them.
    """
    covariances, order = _burg(errors, runs)
    return covariances[: int(order) + 1]


def _burg(errors: FloatArray, runs: IntArray) -> tuple[FloatArray, IntArray]:
    """Autocovariances (..., p + 1) of models of errors (..., N) of the largest order, the best."""
    ahead = behind = np.where(runs > 0, errors, 0.0)
    first = max(int(np.count_nonzero(runs)), 1)  # of what stands all the time, nothing
    observed = np.vecdot(ahead, ahead) / first
    white = WHITE * observed
    variance, gain = observed + white, 0.0 * observed
    covariances, forward = np.zeros((2, *errors.shape[:-1], LARGEST_ORDER + 1))
    criteria = np.full_like(covariances, np.inf)
    covariances[..., 0], forward[..., 0], criteria[..., 0] = variance, 1.0, 0.0
    for k in range(1, LARGEST_ORDER + 1):
        within = runs[k:] > k
        rows = np.count_nonzero(within)
        if rows < PAIRS * k:
            break
        # Of e_t to e_{t-k}: e_t less its forward prediction, e_{t-k} less its backward one.
        ahead, behind = ahead[..., 1:], behind[..., :-1]
        if rows < len(within):
            ahead, behind = ahead * within, behind * within
        own = forward[..., : k + 1]
        mirrored, noise = own[..., ::-1].copy(), white * rows
        common = np.vecdot(ahead, behind) + noise * np.vecdot(own, mirrored)
        squares = np.vecdot(ahead, ahead) + np.vecdot(behind, behind)
        squares = np.maximum(squares + 2 * noise * np.vecdot(own, own), TINY)
        reflection = np.asarray(-2 * common / squares)
        known = np.vecdot(own[..., 1:k], covariances[..., k - 1 : 0 : -1])
        covariances[..., k] = -reflection * variance - known
        variance = variance * (1 - reflection**2)
        gain = gain + np.log1p(-(reflection**2))
        criteria[..., k] = first * gain + k * math.log(first)
        part = reflection[..., None]
        own += part * mirrored
        ahead, behind = ahead + part * behind, behind + part * ahead
    return covariances / (1 + WHITE), np.argmin(criteria, axis=-1)


def within_runs(fit: WorkingFit, corrections: int = CORRECTIONS) -> WorkingFit:
    """The same estimates, their covariance under autoregressive errors of each actuator.

    The covariance is a sandwich, (XᵀX)⁻¹ XᵀΩX (XᵀX)⁻¹ with Ω the covariance of the weighted errors.
    Errors of different actuators count as independent. Rows of a prior are in X, their errors in Ω.
    A posterior stays the same where errors are independent: their size may be known beforehand.
    """
    result, samples, width = fit.result, fit.samples, len(fit.result.parameters)
    problem = samples.problem
    with one_blas_thread():
        inverse = np.asarray(np.linalg.inv(fit.factor[:width, :width]), dtype=np.float64)
        prior = np.zeros((0, width)) if fit.prior is None else fit.prior[:, :width] @ inverse
        residual, squares = samples.residual(result.values), problem.residual_squares(result.values)
        # Round-off of an exact fit is autocorrelated too, but is no error.
        exact = squares <= FIT_ROUND_OFF**2 * problem.force_squares()
        models = dict[int, ErrorModel]()
        for i in map(int, np.flatnonzero(problem.samples)):
            weight = float(result.weights[i])
            models[i] = ErrorModel(
                columns=(samples.regressor[:, i] @ (weight * inverse)) * samples.used[:, i, None],
                residual=(0.0 if exact[i] else weight) * residual[:, i],
                used=samples.used[:, i],
                pieces=samples.pieces,
                least=weight * float(samples.least_errors[i]),
            )

        def filling() -> FloatArray:
            """XᵀΩX of orthonormal columns."""
            parts = (model.sums for model in models.values())
            return np.asarray(sum(parts, prior.T @ prior), dtype=np.float64)

        for _ in range(corrections):
            total = filling()
            for model in models.values():
                model.correct(total)
        covariance = inverse @ filling() @ inverse.T
    each = {i: (m.model, m.effective_samples(), m.informing_samples()) for i, m in models.items()}
    noise = _noise_model(problem, each, result.weights)
    if fit.prior is not None and not noise.coefficients.any():
        return fit.with_result(noise=noise)
    rows = float(noise.effective_samples.sum()) - (width if fit.prior is None else 0)
    # A spectrum by p coefficients has relative variances of up to 4p / N [Berk1974], as a variance
    # by N / 2p degrees of freedom; a parameter may hang on one actuator's alone.
    known = (m.samples / (2 * m.model.order) for m in models.values() if m.model.order)
    freedom = np.array(min([rows, *known]))
    return fit.with_result(covariance=covariance, degrees_of_freedom=freedom, noise=noise)


def residual_noise(samples: FitSamples, values: FloatArray, fitted: float) -> NoiseModel:
    """Errors of each actuator by the residuals at values (n,) alone, for a number of parameters.

    What a fit takes up of slow errors is not added back, as ``within_runs`` does.
    """
    residual, problem = samples.residual(values), samples.problem
    models = dict[int, tuple[Autoregression, float, float]]()
    for i in map(int, np.flatnonzero(problem.samples)):
        used = samples.used[:, i]
        part = max(1.0 - fitted / problem.rows, 1.0 / problem.samples[i])
        covariances = burg_covariances(residual[:, i], run_lengths(used, samples.pieces)) / part
        covariances[0] = max(covariances[0], samples.least_errors[i] ** 2)
        model = Autoregression.of_covariances(covariances)
        worth = model.effective_samples(used, samples.pieces)
        models[i] = model, worth, worth
    return _noise_model(problem, models, np.ones(len(problem.actuators)))


def _noise_model(
    problem: FitProblem, models: dict[int, tuple[Autoregression, float, float]], weights: FloatArray
) -> NoiseModel:
    """Of models and effective samples by actuator, of errors that weights (dof,) multiply."""
    dof, order = len(weights), max((model.order for model, *_ in models.values()), default=0)
    coefficients, worth = np.zeros((dof, order)), np.zeros((2, dof))
    innovation, deviation, lag_one = np.full((3, dof), np.nan)
    for i, (model, *counts) in models.items():
        worth[:, i] = counts
        lags = np.append(model.covariances, 0.0)
        coefficients[i, : model.order] = model.coefficients
        innovation[i], deviation[i] = np.sqrt([model.variance, lags[0]]) / weights[i]
        lag_one[i] = lags[1] / lags[0] if lags[0] > 0 else 0.0
    numbers = innovation, deviation, lag_one, problem.samples, *worth
    return NoiseModel(problem.actuators, coefficients, *numbers)


class ErrorModel:
    """Autoregressive errors of one actuator, corrected for what the fit has taken up of them.

    Weighted columns x (N, n) are orthonormal over all actuators, and zero where a sample is not
    used. Beside them stand weighted residuals (N,), the segments' rows, and the least deviation of
    the errors. ``sums`` (n, n) is the covariance of Σ_t x_t e_t under the ``model`` of the errors
    e. One actuator determines few combinations of all parameters: repeated work is on those alone.
    """

    def __init__(
        self,
        columns: FloatArray,
        residual: FloatArray,
        used: BoolArray,
        pieces: Pieces,
        least: float = 0.0,
    ) -> None:
        shares, turn = np.linalg.eigh(columns.T @ columns)
        self._turn = turn[:, (shares > FIT_ROUND_OFF) | (shares == shares[-1])]
        self._observed = burg_covariances(residual, run_lengths(used, pieces))
        self._observed[0] = max(self._observed[0], least**2)
        # Zeros on both sides of each piece: samples k apart are of one piece, or one is zero.
        lags, count = len(self._observed), len(used) + 2 * len(pieces) * len(self._observed)
        self._pieces = tuple(
            slice(p.start + 2 * k * lags, p.stop + 2 * (k + 1) * lags) for k, p in enumerate(pieces)
        )
        rows = np.concatenate([np.arange(p.start + lags, p.stop - lags) for p in self._pieces])
        self._used = np.zeros(count, dtype=bool)
        self._columns = x = np.zeros((self._turn.shape[1], count))
        self._used[rows], x[:, rows] = used, (columns @ self._turn).T
        self._spectra = Spectra.of(x, self._pieces)
        self._grams = np.array([x[:, : count - k] @ x[:, k:].T for k in range(lags)])
        near = np.convolve(self._used, np.ones(2 * lags - 1), "same") > 0.5
        self._edges = np.flatnonzero(near & ~self._used)
        # How many pairs of used samples are so far apart.
        pairs = [(self._used[: count - k] & self._used[k:]).sum() for k in range(lags)]
        self._pairs = np.array(pairs)
        self.samples = int(self._pairs[0])
        freedom = max(self.samples - float(np.trace(self._grams[0])), 1.0)
        start = Autoregression.of_covariances(self._observed * self.samples / freedom)
        self._least_innovation = KEPT * start.variance * freedom / self.samples
        self._adopt(start)

    def taken_up(self, sums: FloatArray) -> FloatArray:
        """By how much a fit lowers Σ_t e_t e_{t+k} over used pairs, on average; (p + 1,).

        With ``sums`` (n, n) those over all actuators. Of Σ_t u_t (Ω x)_t · (x_{t+k} + x_{t-k}),
        u_t = 1 where a sample is used, the sum over all t is a product of spectra. Unused rows
        next to used ones are then taken off.
        """
        x, near, lags = self._columns, self._edges, range(self.model.order + 1)
        whole = 2 * self._spectra.shared(self._densities, len(lags))
        edges = self._turned[:, near]
        beside = (x.take(near + k, 1, mode="wrap") + x.take(near - k, 1, mode="wrap") for k in lags)
        shared = whole - [np.vdot(edges, each) for each in beside]
        own = self._turn.T @ sums @ self._turn
        left = np.tensordot(self._grams[: len(lags)], own)
        return np.asarray(shared - left, dtype=np.float64)

    def correct(self, sums: FloatArray) -> None:
        """Make the model again, with what the fit takes up under the present models added back.

        A fit takes up what is smooth, so the innovations stay. Where the whole correction would
        shrink them, no process has the autocovariances that it asks for. It is then damped.
        """
        taken = self.taken_up(sums)
        lags = slice(len(taken))
        correction = taken / np.maximum(self._pairs[lags], 1.0)
        for part in DAMPING:
            covariances = self._observed[lags] + part * correction
            model = Autoregression.of_covariances(covariances)
            if model.order == len(covariances) - 1 and model.variance >= self._least_innovation:
                change = np.abs(covariances - self.model.covariances).max()
                if change > SAME * covariances[0]:
                    self._adopt(model)
                return

    def effective_samples(self) -> float:
        """Number of independent samples that would determine the mean error as well."""
        return self.model.effective_samples(self._used, self._pieces)

    def informing_samples(self) -> float:
        """Number of independent samples that would determine what was fitted as well."""
        independent = float(self.model.covariances[0]) * float(np.trace(self._grams[0]))
        spread = max(float(np.trace(self.sums)), independent)
        return self.samples * (independent / spread if spread > 0 else 1.0)

    def _adopt(self, model: Autoregression) -> None:
        """Take a model, and the sums that it leads to."""
        self.model, self._densities = model, self._spectra.densities(model)
        self._turned = self._spectra.turned(self._densities)
        self.sums = self._turn @ (self._columns @ self._turned.T) @ self._turn.T
