"""Covariances of estimates whose errors are correlated from one time to the next.

Errors of each actuator are an autoregressive process. Residuals are smaller, and less
autocorrelated, than the errors are, because a fit takes up whatever of the errors its regressor can
express. A model of slow errors that is fitted to residuals alone gives intervals that are too
narrow; what was taken up has a known expectation and is added back [Worsley2002].

Models are fitted by Burg's method [Percival1993], which never predicts across gaps.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from loopid.arguments import BoolArray, FloatArray, IntArray
from loopid.identification.estimator import WorkingFit
from loopid.identification.problem import ROUND_OFF, FitProblem, FitSamples
from loopid.identification.result import NoiseModel
from loopid.motion.filtering import recursion
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

Pieces = tuple[slice, ...]  # rows of evenly sampled segments, whose errors are independent


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
    def of_covariances(cls, covariances: FloatArray) -> Autoregression:
        """The model with autocovariances (p + 1,) at lags 0 to p, by Levinson's recursion.

        No process has covariances that ask for a reflection coefficient of 1 or more; where they
        do, the model ends at that lag with the largest allowed.
        """
        polynomial, variance = np.ones(1), float(covariances[0])
        for k in range(1, len(covariances)):
            asked = -float(polynomial @ covariances[k:0:-1]) / variance
            reflection = float(np.clip(asked, -LARGEST_REFLECTION, LARGEST_REFLECTION))
            longer = np.append(polynomial, 0.0)
            polynomial = longer + reflection * longer[::-1]
            variance *= 1 - reflection**2
            if reflection != asked:
                break
        return cls(-polynomial[1:], variance)

    @property
    def order(self) -> int:
        """Number p of coefficients."""
        return len(self.coefficients)

    @cached_property
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

    def filtered(self, rows: FloatArray, pieces: Pieces) -> FloatArray:
        """Ω X of rows X (N, m), Ω the covariance of errors, one a row.

        Autocovariances follow the recursion of the process, so a filter N / A with as many
        coefficients has them as its impulse response: Ω X is X filtered forwards and backwards in
        time, less γ_0 X, which both count.
        """
        numerator = np.convolve(self.polynomial, self.covariances)[: max(self.order, 1)]
        found = -self.covariances[0] * rows
        for piece in pieces:
            found[piece] += recursion(numerator, self.polynomial, rows[piece])
            found[piece] += recursion(numerator, self.polynomial, rows[piece][::-1])[::-1]
        return np.asarray(found, dtype=np.float64)

    def sum_variance(self, present: BoolArray, pieces: Pieces) -> float:
        """Variance of the sum of errors over the samples (N,) that are present."""
        ones = np.asarray(present, dtype=np.float64)[:, None]
        return float(np.vdot(ones, self.filtered(ones, pieces)))

    def effective_samples(self, present: BoolArray, pieces: Pieces) -> float:
        """Number of independent samples that would determine the mean error as well."""
        count = float(present.sum())
        spread = self.sum_variance(present, pieces) if self.order else 0.0
        return min(count**2 * float(self.covariances[0]) / spread, count) if spread > 0 else count


def mean_of_series(
    series: FloatArray, counts: IntArray | BoolArray, pieces: Pieces
) -> tuple[float, float]:
    """Mean of numbers, given as sums (N,) of this many each, and its standard error.

    The series is an autoregressive process: times do not count as independent.
    """
    total, present = int(counts.sum()), np.asarray(counts > 0)
    mean, runs = float(series.sum()) / total, run_lengths(present, pieces)
    model = Autoregression.of_covariances(burg_covariances(series - mean * counts, runs))
    return mean, float(np.sqrt(model.sum_variance(present, pieces))) / total


def run_lengths(used: BoolArray, pieces: Pieces) -> IntArray:
    """Length of the unbroken run of used samples of its piece that ends with each sample (N,)."""
    places = np.arange(1, len(used) + 1)
    breaks = np.where(used, 0, places)
    for piece in pieces:
        breaks[piece] = np.maximum.accumulate(np.maximum(breaks[piece], piece.start))
    return places - breaks


def burg_covariances(errors: FloatArray, runs: IntArray) -> FloatArray:
    """Autocovariances (p + 1,) of a model of errors (N,), its order p chosen by BIC [Schwarz1978].

    Forward and backward predictions within unbroken runs only [Burg1975], so that gaps are never
    predicted across; ``runs`` (N,) are as of ``run_lengths``, 0 where a sample is not used. The
    errors count as if a little white noise had been added to them, by what it adds to the sums on
    average.
    """
    products, rows = _window_products(errors, runs, LARGEST_ORDER)
    observed = float(products[0, 0, 0] / rows[0])
    white = WHITE * observed
    polynomial, covariances = np.zeros((2, LARGEST_ORDER + 1))
    polynomial[0], criteria = 1.0, [0.0]
    covariances[0] = variance = observed + white
    for k in range(1, LARGEST_ORDER + 1):
        if rows[k] < PAIRS * k or not observed > 0:
            break
        window, past = products[k, : k + 1, : k + 1], polynomial[1:k]
        # Of e_t to e_{t-k}: e_t less its forward prediction, e_{t-k} less its backward one.
        ahead = polynomial[: k + 1]
        behind = ahead[::-1]
        common = ahead @ window @ behind + rows[k] * white * (past @ past[::-1])
        energy = ahead @ window @ ahead + behind @ window @ behind
        energy += 2 * rows[k] * white * (ahead @ ahead)
        reflection = -2 * float(common / energy)
        covariances[k] = -reflection * variance - past @ covariances[k - 1 : 0 : -1]
        polynomial[: k + 1] = ahead + reflection * behind
        variance *= 1 - reflection**2
        criteria.append(rows[0] * np.log(variance / covariances[0]) + k * np.log(rows[0]))
    best = int(np.argmin(criteria))
    return np.asarray(covariances[: best + 1] / (1 + WHITE))


def _window_products(errors: FloatArray, runs: IntArray, order: int) -> tuple[FloatArray, IntArray]:
    """For each k up to an order, Σ w wᵀ over the rows whose run is longer, and their number.

    w = (e_t, e_{t-1}, ...) up to that order, of which the first k + 1 are within the run. All that
    Burg's recursion adds up are quadratic forms of these sums, so one pass serves every order.
    """
    width = order + 1
    products, counts = np.zeros((width, width, width)), np.zeros(width, dtype=np.int64)
    series = np.pad(np.where(runs > 0, errors, 0.0), (order, 0))
    windows, reach = sliding_window_view(series, width)[:, ::-1], np.minimum(runs, width)
    for length in np.unique(reach[reach > 0]):
        inside = windows[reach == length, :length]
        products[length - 1, :length, :length] = inside.T @ inside
        counts[length - 1] = len(inside)
    return np.cumsum(products[::-1], axis=0)[::-1], np.cumsum(counts[::-1])[::-1]


def within_runs(fit: WorkingFit, corrections: int = CORRECTIONS) -> WorkingFit:
    """The same estimates, their covariance under autoregressive errors of each actuator.

    The covariance is a sandwich, (XᵀX)⁻¹ XᵀΩX (XᵀX)⁻¹ with Ω the covariance of the weighted errors;
    errors of different actuators count as independent. Rows of a prior are in X, their errors in Ω.
    A posterior stays the same where errors are independent: their size may be known beforehand.
    """
    result, samples, width = fit.result, fit.samples, len(fit.result.parameters)
    with one_blas_thread():
        inverse = np.asarray(np.linalg.inv(fit.factor[:width, :width]), dtype=np.float64)
        prior = np.zeros((0, width)) if fit.prior is None else fit.prior[:, :width] @ inverse
        models = _error_models(fit, inverse)

        def filling() -> FloatArray:
            """XᵀΩX of orthonormal columns."""
            parts = (model.sums for model in models.values())
            return np.asarray(sum(parts, prior.T @ prior), dtype=np.float64)

        for _ in range(corrections):
            total = filling()
            for model in models.values():
                model.correct(total)
        covariance = inverse @ filling() @ inverse.T
    each = {i: (m.model, m.effective_samples()) for i, m in models.items()}
    noise = _noise_model(samples.problem, each, result.weights)
    if fit.prior is not None and not noise.coefficients.any():
        return replace(fit, result=replace(result, noise=noise))
    rows = float(noise.effective_samples.sum()) - (width if fit.prior is None else 0)
    # A spectrum by p coefficients has relative variances of up to 4p / N [Berk1974], as a variance
    # by N / 2p degrees of freedom; a parameter may hang on one actuator's alone.
    known = (m.samples / (2 * m.model.order) for m in models.values() if m.model.order)
    freedom = np.array(min([rows, *known]))
    found = replace(result, covariance=covariance, degrees_of_freedom=freedom, noise=noise)
    return replace(fit, result=found)


def residual_noise(samples: FitSamples, values: FloatArray, fitted: float) -> NoiseModel:
    """Errors of each actuator by the residuals at values (n,) alone, for a number of parameters.

    What a fit takes up of slow errors is not added back, as ``within_runs`` does.
    """
    residual, problem = samples.residual(values), samples.problem
    models = dict[int, tuple[Autoregression, float]]()
    for i in map(int, np.flatnonzero(problem.samples)):
        used = samples.used[:, i]
        part = max(1.0 - fitted / problem.rows, 1.0 / problem.samples[i])
        covariances = burg_covariances(residual[:, i], run_lengths(used, samples.pieces)) / part
        covariances[0] = max(covariances[0], samples.least_errors[i] ** 2)
        model = Autoregression.of_covariances(covariances)
        models[i] = model, model.effective_samples(used, samples.pieces)
    return _noise_model(problem, models, np.ones(len(problem.actuators)))


def _error_models(fit: WorkingFit, inverse: FloatArray) -> dict[int, ErrorModel]:
    """A model for each actuator that has samples, by its number."""
    result, samples, problem, models = fit.result, fit.samples, fit.samples.problem, {}
    residual, squares = samples.residual(result.values), problem.residual_squares(result.values)
    # Round-off of an exact fit is autocorrelated too, but is no error.
    exact = squares <= ROUND_OFF**2 * problem.force_squares()
    for i in map(int, np.flatnonzero(problem.samples)):
        weight = float(result.weights[i])
        models[i] = ErrorModel(
            columns=(samples.regressor[:, i] @ (weight * inverse)) * samples.used[:, i, None],
            residual=(0.0 if exact[i] else weight) * residual[:, i],
            used=samples.used[:, i],
            pieces=samples.pieces,
            least=weight * float(samples.least_errors[i]),
        )
    return models


def _noise_model(
    problem: FitProblem, models: dict[int, tuple[Autoregression, float]], weights: FloatArray
) -> NoiseModel:
    """Of models and effective samples by actuator, of errors that weights (dof,) multiply."""
    dof, order = len(weights), max((model.order for model, _ in models.values()), default=0)
    coefficients, effective = np.zeros((dof, order)), np.zeros(dof)
    innovation, deviation, lag_one = np.full((3, dof), np.nan)
    for i, (model, worth) in models.items():
        lags = np.append(model.covariances, 0.0)
        coefficients[i, : model.order] = model.coefficients
        innovation[i], deviation[i] = np.sqrt([model.variance, lags[0]]) / weights[i]
        lag_one[i] = lags[1] / lags[0] if lags[0] > 0 else 0.0
        effective[i] = worth
    numbers = innovation, deviation, lag_one, problem.samples, effective
    return NoiseModel(problem.actuators, coefficients, *numbers)


class ErrorModel:
    """Autoregressive errors of one actuator, corrected for what the fit has taken up of them.

    Of weighted columns x (N, n), orthonormal over all actuators and zero where a sample is not
    used, weighted residuals (N,), the segments' rows, and the least deviation of the errors.
    ``sums`` (n, n) is the covariance of Σ_t x_t e_t under the ``model`` of the errors e. One
    actuator determines few combinations of all parameters: repeated work is on those alone.
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
        self._turn = turn[:, (shares > ROUND_OFF) | (shares == shares[-1])]
        self._columns, self._used, self._pieces = columns @ self._turn, used, pieces
        self._observed = burg_covariances(residual, run_lengths(used, pieces))
        self._observed[0] = max(self._observed[0], least**2)
        apart = [_apart(pieces, k) for k in range(len(self._observed))]
        x = self._columns
        self._grams = np.array(
            [sum((x[a].T @ x[b] for a, b in rows), np.zeros(2 * x.shape[1:])) for rows in apart]
        )
        # How many pairs of used samples are so far apart.
        self._pairs = np.array([sum((used[a] & used[b]).sum() for a, b in rows) for rows in apart])
        self.samples = int(self._pairs[0])
        freedom = max(self.samples - float(np.trace(self._grams[0])), 1.0)
        start = Autoregression.of_covariances(self._observed * self.samples / freedom)
        self._least_innovation = KEPT * start.variance * freedom / self.samples
        self._adopt(start)

    def taken_up(self, sums: FloatArray) -> FloatArray:
        """By how much a fit lowers Σ_t e_t e_{t+k} over used pairs, on average; (p + 1,).

        With ``sums`` (n, n) those over all actuators.
        """
        own = self._turn.T @ sums @ self._turn
        left = np.tensordot(self._grams[: len(self._shared)], own)
        return np.asarray(self._shared - left, dtype=np.float64)

    def correct(self, sums: FloatArray) -> None:
        """Make the model again, with what the fit takes up under the present models added back.

        A fit takes up what is smooth, so the innovations stay. Where the whole correction would
        shrink them, no process has the autocovariances that it asks for, and it is damped.
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

    def _adopt(self, model: Autoregression) -> None:
        """Take a model, and the sums that it leads to.

        ``_shared`` is Σ_t u_t (Ω x)_t · (x_{t+k} + x_{t-k}), u_t = 1 where a sample is used.
        """
        self.model, X = model, self._columns
        turned = model.filtered(X, self._pieces)
        self.sums = self._turn @ (X.T @ turned) @ self._turn.T
        turned *= self._used[:, None]
        self._shared = np.array(
            [
                sum(
                    float(np.vdot(turned[a], X[b]) + np.vdot(turned[b], X[a]))
                    for a, b in _apart(self._pieces, k)
                )
                for k in range(model.order + 1)
            ]
        )


def _apart(pieces: Pieces, k: int) -> list[tuple[slice, slice]]:
    """Rows of each piece that have others k later, and these."""
    long = [piece for piece in pieces if piece.stop - piece.start > k]
    return [(slice(p.start, p.stop - k), slice(p.start + k, p.stop)) for p in long]
