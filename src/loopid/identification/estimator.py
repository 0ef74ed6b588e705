"""What an estimator is, and the registry of all of them: a new one is a file and a line.

An estimator may clip forces, project regressors or use prior knowledge. Its estimates still solve Σ
x_t (y_t - x_tᵀ φ) = 0 for some regressor x and forces y, the *working* samples. Their residuals are
the errors that add up in the estimates. So one computation of the uncertainty, which allows for
autocorrelated residuals, serves all estimators.

Rows of each actuator are weighted by one over the deviation of its errors. Weights that follow from
the residuals that they lead to are found by iteration [Gautier1997].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dtrtri

from loopid.arguments import BoolArray, FloatArray
from loopid.errors import DataError, OptionError, RankError, counted
from loopid.identification.problem import FitProblem, FitSamples
from loopid.identification.quality import fit_quality
from loopid.identification.result import Fit
from loopid.numbers import FIT_ROUND_OFF, SUM_ROUND_OFF
from loopid.records import record
from loopid.registry import Registry
from loopid.workers import one_blas_thread


@record(checked="outside")
class WorkingFit:
    """A fit, and the least squares that it amounts to.

    Attributes
    ----------
    result : Fit
    samples : FitSamples
        Working samples: with the weights of the result, and the rows of the prior, their least
        squares are the values of the result.
    prior : FloatArray or None
        (k, n + 1), rows [L | L φ₀] of the prior, their errors of unit variance.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.identification import FitSamples, WorkingFit, fit
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> W = np.random.default_rng(0).normal(size=(100, 1, 2))
    >>> samples = FitSamples.of(names, ["motor"], W, W @ [2.0, 0.5])
    >>> WorkingFit(fit(samples), samples).prior is None
    True
    """

    result: Fit
    samples: FitSamples
    prior: FloatArray | None = None

    @classmethod
    def of(
        cls, name: str, samples: FitSamples, weights: FloatArray, prior: FloatArray | None = None
    ) -> WorkingFit:
        """The least squares of samples times weights (dof,), of known size, and rows of a prior."""
        factor = samples.problem.weighted(weights, prior)
        R = factor[:-1, :-1]
        values = solve_triangular(R, factor[:-1, -1])
        result = result_of(name, samples.problem, values, R, weights, 1.0)
        return cls(result, samples, prior)._with_factor(factor)

    @cached_property
    def factor(self) -> FloatArray:
        """Triangular factor (n + 1, n + 1) of all weighted rows, those of the prior included."""
        return self.samples.problem.weighted(self.result.weights, self.prior)

    def with_result(self, **changes: Any) -> WorkingFit:
        """The same least squares with a result that is changed, but for its weights."""
        changed = replace(self, result=replace(self.result, **changes))
        return changed._with_factor(self.factor)

    def _with_factor(self, factor: FloatArray) -> WorkingFit:
        vars(self)["factor"] = factor
        return self

    def response(self, force: FloatArray) -> FloatArray:
        """Change of the estimates (n, k) with further forces (N, dof, k)."""
        weights = self.result.weights**2 * self.samples.used
        sums = np.einsum("tij,ti,tik->jk", self.samples.regressor, weights, force, optimize=True)
        return np.asarray(cho_solve((self.factor[:-1, :-1], False), sums))


class Estimator:
    """A way of finding parameters: a record of its options with ``_fit`` or ``fit_samples``.

    Triangular factors are enough for ``_fit``, which finds a ``Fit`` for independent errors. An
    estimator that needs the samples has ``fit_samples`` instead. A new one is a file, and a line in
    ``ESTIMATORS``.

    Examples
    --------
    >>> from loopid.identification import ESTIMATORS, Estimator
    >>> sorted(ESTIMATORS)
    ['bisquare', 'iv', 'ols', 'wls']
    >>> all(issubclass(each, Estimator) for each in ESTIMATORS.values())
    True
    """

    name: ClassVar[str]

    def fit(self, problem: FitProblem) -> Fit:
        """Estimate the parameters, with the covariance for independent errors.

        Raises
        ------
        OptionError
            When the estimator needs the samples themselves.
        DataError
            When there are not more rows than parameters.
        RankError
            When the data do not excite a combination of parameters.
        """
        require_rows(problem)
        with one_blas_thread():
            return self._fit(problem)

    def fit_samples(self, samples: FitSamples) -> WorkingFit:
        """Estimate the parameters as ``fit``, and state the least squares that they solve."""
        return WorkingFit(self.fit(samples.problem), samples)

    def _fit(self, problem: FitProblem) -> Fit:
        raise OptionError(
            f"{self.name} needs the samples, not only their triangular factors: "
            "use fit(samples, estimator)"
        )


ESTIMATORS: Registry[type[Estimator]] = Registry(
    "estimator",
    {
        "ols": "loopid.identification.estimator:OrdinaryLeastSquares",
        "wls": "loopid.identification.estimator:WeightedLeastSquares",
        "bisquare": "loopid.identification.robust:Bisquare",
        "iv": "loopid.identification.instrumental:InstrumentalVariables",
    },
)


def chosen_estimator(estimator: str | Estimator) -> Estimator:
    """An estimator, or the one with a name."""
    return estimator if isinstance(estimator, Estimator) else ESTIMATORS[estimator]()


def require_rows(problem: FitProblem) -> None:
    """Refuse problems with no more rows than parameters."""
    if problem.freedom < 1:
        count = len(problem.parameters)
        raise DataError(
            f"{counted(problem.rows, 'force')} cannot determine {counted(count, 'parameter')}: "
            "use more of the log, or a longer one",
            rows=problem.rows,
            parameters=count,
        )


# Smallest over largest singular value, of columns scaled to unit length, that data must excite.
LEAST_EXCITATION = 1e-8
# Part in the unidentifiable directions, relative to the largest, above which a parameter is named.
INVOLVED = 0.1
# Weights have converged that change by less than this part, or than round-off of the forces: all
# that is known of errors that are as small. Iterations to them at most.
CONVERGED, ITERATIONS = 1e-10, 500


def solved(
    problem: FitProblem, weights: FloatArray, prior: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Least squares (n,) of the weighted rows, and their triangular factor (n, n).

    With the rows (k, n + 1) of a prior, their errors of unit variance.
    """
    factor = problem.weighted(weights, prior)
    R = factor[:-1, :-1]
    require_excitation(problem, R)
    return np.asarray(solve_triangular(R, factor[:-1, -1]), dtype=np.float64), R


def leverages(problem: FitProblem, weights: FloatArray, R: FloatArray) -> FloatArray:
    """Part of the parameters (dof,) that each actuator determines; they sum to n.

    By the triangular factor R (n, n) of all weighted rows, which is regular.
    """
    columns = weights[:, None, None] * problem.factors[:, :, :-1] @ dtrtri(R)[0]
    return np.asarray((columns**2).sum(axis=(1, 2)), dtype=np.float64)


def equal_weights(problem: FitProblem) -> FloatArray:
    """1 for each actuator (dof,) with samples, 0 for the others."""
    return np.where(problem.samples > 0, 1.0, 0.0)


ROUNDS = 3  # of weights: sizes of errors need only be about right
UNKNOWN = 1e-6  # relative singular values, below which directions stay as in the robot file


def excited_solution(rows: FloatArray, least: float) -> tuple[FloatArray, int]:
    """Least squares (n,) of rows [X | y], none along directions of no effect, and their rank.

    That is singular values, of columns of unit length, below this part of the largest.
    """
    X, y = rows[:, :-1], rows[:, -1]
    lengths = np.linalg.norm(X, axis=0)
    lengths = np.where(lengths > 0, lengths, 1.0)
    x, _, rank, _ = np.linalg.lstsq(X / lengths, y, rcond=least)
    return np.asarray(x / lengths, dtype=np.float64), int(rank)


def nearest_to_file(
    problem: FitProblem,
    file: FloatArray,
    freedom: FloatArray,
    prior: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Values (n,) that are those of the robot file where nothing is known, and weights (dof,).

    Weights are one over the errors of the actuators, by their freedom (dof,). Rows (k, n + 1) of a
    prior are fitted, too.
    """
    weights, values = problem.force_weights, file
    for _ in range(ROUNDS):
        rows = problem.weighted(weights, prior)
        rows[:, -1] -= rows[:, :-1] @ file
        values = file + excited_solution(rows, UNKNOWN)[0]
        weights = inverse_deviations(problem, problem.residual_squares(values), freedom)
    return values, weights


def inverse_deviations(problem: FitProblem, squares: FloatArray, freedom: FloatArray) -> FloatArray:
    """Weights (dof,) from sums of squared residuals (dof,) over each actuator's freedom (dof,).

    The freedom of an actuator is its samples less its leverage. Errors are at least the stated
    ones, or the round-off of the forces: noise-free data have finite weights. Actuators without
    samples have weight 0.
    """
    present, left = problem.samples > 0, freedom > FIT_ROUND_OFF * problem.samples
    variances = np.divide(squares, freedom, out=np.zeros(len(squares)), where=left)
    least = np.maximum(problem.least_errors, FIT_ROUND_OFF * problem.force_rms)
    deviations = np.sqrt(np.maximum(variances, least**2))
    undefined = present & ((deviations == 0) | (~left & (problem.least_errors == 0)))
    if undefined.any():
        name = problem.actuators[int(undefined.argmax())]
        raise DataError(
            f"actuator {name} is fitted without error: its weight is undefined; use ols",
            actuator=name,
        )
    return np.where(present, 1.0 / np.where(present, deviations, 1.0), 0.0)


def converged_weights(
    problem: FitProblem,
    fitted: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """Weights (dof,) that are the inverse deviations of the residuals that they lead to.

    Of given weights (dof,), ``fitted`` makes the values (n,) and leverages (dof,) of the fit.
    """
    force, present = problem.force_rms, problem.samples > 0
    # Motors that contradict each other have several such weights: units do not choose among them.
    weights = np.where(force > 0, problem.force_weights, equal_weights(problem))
    for _ in range(ITERATIONS):
        values, leverage = fitted(weights)
        last, squares = weights, problem.residual_squares(values)
        weights = inverse_deviations(problem, squares, problem.samples - leverage)
        change = np.abs(weights[present] / last[present] - 1.0).max(initial=0.0)
        if change <= max(CONVERGED, SUM_ROUND_OFF * (weights * force).max()):
            return weights
    raise DataError(
        f"the weights do not converge in {ITERATIONS} iterations: use ols", iterations=ITERATIONS
    )


def result_of(
    name: str,
    problem: FitProblem,
    values: FloatArray,
    R: FloatArray,
    weights: FloatArray,
    variance: float,
) -> Fit:
    """The result whose covariance for independent errors is variance · (RᵀR)⁻¹."""
    inverse = np.linalg.inv(R)
    return Fit(
        estimator=name,
        parameters=problem.parameters,
        actuators=problem.actuators,
        values=values,
        covariance=variance * inverse @ inverse.T,
        condition_number=float(np.linalg.cond(R)),
        degrees_of_freedom=np.array(float(max(problem.freedom, 1))),
        quality=fit_quality(problem, values),
        weights=weights,
    )


def require_excitation(problem: FitProblem, R: FloatArray) -> None:
    """Refuse a triangular factor (n, n) whose scaled columns are linearly dependent."""
    labels = problem.parameters.labels
    if (silent := _silent(R)).any():
        name = labels[int(silent.argmax())]
        raise RankError(f"the data do not excite {name} at all", parameters=(name,))
    # Of columns of unit length |R| |R⁻¹|, by Frobenius' norm, is at least the ratio of singular
    # values: where that is fine, it takes none of them.
    lengths = np.linalg.norm(R, axis=0)
    inverse, singular = dtrtri(R / lengths)
    if not singular and len(R) * np.square(inverse).sum() * LEAST_EXCITATION**2 <= 1:
        return
    _, values, right = scaled_svd(R)
    if values[-1] >= LEAST_EXCITATION * values[0]:
        return
    # Round-off turns the single directions where there are several: only their span is named.
    part = np.linalg.norm(right[values < LEAST_EXCITATION * values[0]], axis=0)
    names = tuple(labels[j] for j in np.flatnonzero(part > INVOLVED * part.max()))
    raise RankError(
        f"the data do not excite a combination of {', '.join(names)}: "
        f"relative singular value {values[-1] / values[0]:.1e} (least {LEAST_EXCITATION:g}); fit "
        "base parameters, or use a motion that excites them",
        parameters=names,
        singular_value=float(values[-1] / values[0]),
        tolerance=LEAST_EXCITATION,
    )


def excited_rank(R: FloatArray, usual: FloatArray) -> int:
    """Number of combinations of parameters that the data of a triangular factor (n, n) excite.

    Columns that are short beside their usual lengths (n,), as in random states, count as none.
    Alone they would be as long as any other.
    """
    sensed = np.linalg.norm(R, axis=0) > LEAST_EXCITATION * usual
    _, values, _ = scaled_svd(np.where(sensed, R, 0.0))
    return int((values >= LEAST_EXCITATION * (values[0] or np.inf)).sum())


def scaled_svd(R: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lengths (n,) of the columns of R (r, n), 1 for none; with columns over these, its SVD.

    That is singular values (n,) and right vectors (n, n), in rows. Columns of round-off are none.
    """
    silent = _silent(R)
    lengths = np.where(silent, 1.0, np.linalg.norm(R, axis=0))
    _, values, right = np.linalg.svd(np.where(silent, 0.0, R / lengths))
    return lengths, values, right


def excited_combinations(samples: FitSamples, least: float = LEAST_EXCITATION) -> FitSamples:
    """The samples of those combinations of parameters only that they excite, of equal effect.

    By singular values of at least this part of the largest, motors weighted by their forces.
    """
    R = samples.problem.weighted(samples.problem.force_weights)
    lengths, values, right = scaled_svd(R[:-1, :-1])
    kept = values >= least * values[0]
    return samples.along((right[kept] / values[kept, None]).T / lengths[:, None])


def _silent(R: FloatArray) -> BoolArray:
    """Columns (n,) of R (r, n) that are zero, or round-off, as of a symmetric motion.

    Units and sizes of robots part columns by far less.
    """
    norms = np.linalg.norm(R, axis=0)
    return np.asarray(norms <= SUM_ROUND_OFF * norms.max(initial=0.0))


@record
class OrdinaryLeastSquares(Estimator):
    """All actuators count alike.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.identification import FitSamples, OrdinaryLeastSquares, fit
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> W = np.random.default_rng(0).normal(size=(100, 1, 2))
    >>> samples = FitSamples.of(names, ["motor"], W, W @ [2.0, 0.5])
    >>> fit(samples, OrdinaryLeastSquares()).values.round(6).tolist()
    [2.0, 0.5]
    """

    name = "ols"

    def _fit(self, problem: FitProblem) -> Fit:
        weights = equal_weights(problem)
        values, R = solved(problem, weights)
        variance = problem.residual_squares(values).sum() / problem.freedom
        return result_of(self.name, problem, values, R, weights, variance)


@record
class WeightedLeastSquares(Estimator):
    """The variances are found by iteration.

    Examples
    --------
    >>> import numpy as np, loopid
    >>> from loopid.identification import FitSamples, WeightedLeastSquares, fit
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> W = np.random.default_rng(0).normal(size=(100, 1, 2))
    >>> samples = FitSamples.of(names, ["motor"], W, W @ [2.0, 0.5])
    >>> fit(samples, WeightedLeastSquares()).values.round(6).tolist()
    [2.0, 0.5]
    """

    name = "wls"

    def _fit(self, problem: FitProblem) -> Fit:
        def fitted(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
            values, R = solved(problem, weights)
            return values, leverages(problem, weights, R)

        weights = converged_weights(problem, fitted)
        values, R = solved(problem, weights)
        return result_of(self.name, problem, values, R, weights, 1.0)
