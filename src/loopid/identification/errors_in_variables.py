"""Estimators for a regressor with errors, as where positions are noisy: it biases least squares.

*Instrumental variables* [Janot2014]. Instruments Z, the regressor of a motion whose errors are
independent of those of the regressor X, give ZᵀX φ = Zᵀy. With the projection X̂ = Z (ZᵀZ)⁻¹ ZᵀX of
X on Z, these are the least squares of y on X̂ [Soderstrom1989]: working samples are X̂ and X̂φ + r,
with the residuals r of X itself.

*Total least squares* [VanHuffel1991]. Rows [x | y] have independent errors of deviations [d | 1]
times one unknown number. With D = diag d and σ the smallest singular value of [X D⁻¹ | y], the
estimates solve (XᵀX - σ² D²) φ = Xᵀy. With residuals r and g² = 1 + φᵀD²φ, the corrected rows
x̂ = x + r D²φ / g² are uncorrelated with r, and X̂ᵀr = 0. Errors of the estimates are A⁻¹ Σ x̂ r with
A = XᵀX - σ² D² [Fuller1987]: those of least squares on the working regressor X̂ (X̂ᵀX̂)⁻¹ A.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from loopid.arguments import checked_fields
from loopid.arrays import ComparedByFields, FloatArray, finite, frozen
from loopid.errors import DataError, OptionError, RankError
from loopid.identification.least_squares import (
    Estimator,
    WorkingFit,
    converged_weights,
    equal_weights,
    require_excitation,
    require_rows,
    result_of,
)
from loopid.identification.problem import FitProblem, FitSamples
from loopid.identification.result import FitResult
from loopid.observation import triangular_factor
from loopid.scratch import mapped_rows, row_blocks
from loopid.workers import one_blas_thread

# Statistic F of the regression of the regressor on the instruments, in the direction that these
# determine least, below which they are too weak for intervals to hold [Staiger1997].
LEAST_STRENGTH = 10.0
# By how much the smallest singular value of the regressor must exceed that with the forces,
# relatively, for there to be one solution.
LEAST_GAP = 1e-6


@checked_fields
@dataclass(frozen=True)
class InstrumentalVariables(Estimator):
    """Estimates by instruments, which the samples bring (``FitSamples.with_instruments``).

    Attributes
    ----------
    weighted : bool
        Whether each actuator counts by its own error variance, as in weighted least squares, or all
        alike.

    Examples
    --------
    A measured regressor with errors, and that of the commanded motion as instruments:

    >>> import loopid, numpy as np
    >>> names = loopid.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(5000, 1, 2))
    >>> force = W @ [2.0, 0.5] + 0.1 * rng.normal(size=(5000, 1))
    >>> measured = W + 0.3 * rng.normal(size=W.shape)
    >>> samples = loopid.identification.FitSamples.of(names, ["motor"], measured, force)
    >>> samples = samples.with_instruments(W)
    >>> loopid.fit(samples, loopid.identification.InstrumentalVariables()).values.round(1).tolist()
    [2.0, 0.5]
    """

    name = "iv"
    weighted: bool = True

    def fit_samples(self, samples: FitSamples) -> WorkingFit:
        """As of ``Estimator``.

        Raises
        ------
        OptionError
            When the samples have no instruments.
        RankError
            When the instruments are too weak for a combination of parameters.
        """
        if samples.instruments is None:
            raise OptionError(
                "iv needs instruments, the regressor of a motion whose errors are independent: "
                "pass samples.with_instruments(instruments)"
            )
        problem, Z = samples.problem, samples.instruments
        require_rows(problem)
        with one_blas_thread():
            factors = _joint_factors(samples, Z)

            def fitted(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
                rows = weights[:, None, None] * factors
                own, shared, values = _projection(problem, rows)
                # Leverages are tr Xᵢ (ZᵀX)⁻¹ Zᵢᵀ.
                columns = rows[:, :, : len(own)] @ np.linalg.inv(own)
                leverage = columns * (rows[:, :, len(own) : -1] @ np.linalg.inv(shared))
                return values, leverage.sum(axis=(1, 2))

            weights = (
                converged_weights(problem, fitted) if self.weighted else equal_weights(problem)
            )
            own, shared, values = _projection(problem, weights[:, None, None] * factors)
            variance = 1.0
            if not self.weighted:
                variance = float(weights**2 @ problem.residual_squares(values)) / problem.freedom
            result = result_of(self.name, problem, values, shared, weights, variance)
        turn, residual = np.linalg.solve(own, shared), samples.residual(values)
        X = mapped_rows(lambda rows: Z[rows] @ turn, len(Z))
        force = mapped_rows(lambda rows: X[rows] @ values + residual[rows], len(Z))
        return WorkingFit(result, replace(samples, regressor=X, force=force))


def _joint_factors(samples: FitSamples, instruments: FloatArray) -> FloatArray:
    """Triangular factors (dof, 2n + 1, 2n + 1) of [Z | X | y], an actuator each."""
    dof, width = len(samples.actuators), 2 * len(samples.parameters) + 1
    factors = np.zeros((dof, width, width))
    for rows in row_blocks(len(samples)):
        parts = instruments[rows], samples.regressor[rows], samples.force[rows][:, :, None]
        block = np.concatenate(parts, axis=2) * samples.used[rows][:, :, None]
        factors = triangular_factor(np.concatenate([factors, block.transpose(1, 0, 2)], axis=1))
    return factors


def _projection(problem: FitProblem, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Z = Q Rz and P = Qᵀ X of weighted rows of [Z | X | y]: Rz, P (n, n), estimates (n,).

    The projection of X on Z is X̂ = Q P.
    """
    width = len(problem.parameters)
    whole = triangular_factor(rows.reshape(-1, rows.shape[-1]))
    own, shared = whole[:width, :width], whole[:width, width:-1]
    R = triangular_factor(whole[:, width:-1])
    for part in (own, shared, R):
        require_excitation(problem, part)
    cosine = float(np.linalg.svd(shared @ np.linalg.inv(R), compute_uv=False)[-1])
    unexplained = max(1.0 - cosine**2, np.finfo(float).eps)
    strength = problem.freedom / width * cosine**2 / unexplained
    if strength < LEAST_STRENGTH:
        raise RankError(
            f"the instruments are too weak: F statistic {strength:.2g} of the combination of "
            f"parameters that they determine least (least {LEAST_STRENGTH:g}); are they of "
            "the same motion?"
        )
    return own, shared, np.asarray(np.linalg.solve(shared, whole[:width, -1]), dtype=np.float64)


@checked_fields
@dataclass(frozen=True, eq=False, repr=False)
class TotalLeastSquares(ComparedByFields, Estimator):
    """Least squares for a regressor with independent errors.

    Attributes
    ----------
    column_errors : FloatArray, optional
        (n,), deviation of the errors in each column of the regressor, relative to that of the
        forces; 0 for exact columns. By default 1, the textbook's total least squares, which only
        makes sense where all columns are measured in the same unit with the same errors.
    force_errors : FloatArray, optional
        (dof,), size of the errors in the rows of each actuator, relative to each other.

    Examples
    --------
    Errors of the same size in forces and regressor, which bias ordinary least squares:

    >>> import loopid, numpy as np
    >>> names = loopid.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(5000, 1, 2))
    >>> force = W @ [2.0, 0.5] + 0.3 * rng.normal(size=(5000, 1))
    >>> measured = W + 0.3 * rng.normal(size=W.shape)
    >>> samples = loopid.identification.FitSamples.of(names, ["motor"], measured, force)
    >>> loopid.fit(samples, loopid.identification.TotalLeastSquares()).values.round(1).tolist()
    [2.0, 0.5]
    >>> bool(loopid.fit(samples, "ols").values[0] < 1.9)
    True
    """

    name = "tls"
    column_errors: FloatArray | None = None
    force_errors: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("column_errors", "force_errors"):
            given = getattr(self, name)
            if given is None:
                continue
            sizes, what = finite(given, name), name.replace("_", " ")
            if (sizes < 0).any():
                raise OptionError(f"{what} must be numbers from 0 on, not {sizes.min()}")
            object.__setattr__(self, name, frozen(sizes))
        if self.force_errors is not None and not (self.force_errors > 0).all():
            raise OptionError("force errors must be above 0")

    def _fit(self, problem: FitProblem) -> FitResult:
        return self._solved(problem)[0]

    def fit_samples(self, samples: FitSamples) -> WorkingFit:
        """As of ``Estimator``."""
        require_rows(samples.problem)
        with one_blas_thread():
            result, slope, turn = self._solved(samples.problem)
        values, residual = result.values, samples.residual(result.values)

        def corrected(rows: slice) -> FloatArray:
            moved = samples.regressor[rows] + residual[rows][:, :, None] * slope
            return np.asarray(moved @ turn, dtype=np.float64)

        W = mapped_rows(corrected, len(samples))
        force = mapped_rows(lambda rows: W[rows] @ values + residual[rows], len(samples))
        return WorkingFit(result, replace(samples, regressor=W, force=force))

    def _solved(self, problem: FitProblem) -> tuple[FitResult, FloatArray, FloatArray]:
        """The result, D²φ / g² (n,), and what turns corrected rows into working ones (n, n)."""
        width, dof = len(problem.parameters), len(problem.actuators)
        sizes = _sizes("column_errors", self.column_errors, width)
        weights = equal_weights(problem) / _sizes("force_errors", self.force_errors, dof)
        factor = problem.weighted(weights)
        require_excitation(problem, factor[:width, :width])
        values, least = _solution(factor, sizes)
        slope = sizes**2 * values / (1.0 + float((sizes * values) @ (sizes * values)))
        residual = factor @ np.append(-values, 1.0)
        corrected = triangular_factor(factor[:, :width] + np.outer(residual, slope))
        bread = factor[:, :width].T @ factor[:, :width] - least**2 * np.diag(sizes**2)
        turn = np.asarray(np.linalg.solve(corrected.T @ corrected, bread), dtype=np.float64)
        variance = float(residual @ residual) / problem.freedom
        result = result_of(self.name, problem, values, corrected @ turn, weights, variance)
        return result, slope, turn


def _sizes(name: str, given: FloatArray | None, count: int) -> FloatArray:
    sizes = np.ones(count) if given is None else given
    if sizes.shape != (count,):
        raise DataError(f"{name} must have shape ({count},), not {sizes.shape}")
    return sizes


def _solution(factor: FloatArray, sizes: FloatArray) -> tuple[FloatArray, float]:
    """Estimates (n,) and σ from the triangular factor (n + 1, n + 1) of [X | y].

    Exact columns are eliminated first, which leaves the others with the forces.
    """
    width = len(sizes)
    exact, noisy = np.flatnonzero(sizes == 0), np.flatnonzero(sizes > 0)
    R, k = triangular_factor(factor[:, [*exact, *noisy, width]]), len(exact)
    scaled = R[k:, k:] / np.append(sizes[noisy], 1.0)
    _, singular, right = np.linalg.svd(scaled)
    least, direction = float(singular[-1]), right[-1]
    if len(noisy):
        own = float(np.linalg.svd(scaled[:, :-1], compute_uv=False)[-1])
        if own <= (1 + LEAST_GAP) * least:
            raise RankError(
                "total least squares has no single solution: the errors are as large as the "
                f"excitation of a parameter (singular values {least:.3g} with and {own:.3g} "
                "without the forces); give smaller column_errors, or use instrumental variables"
            )
    values = np.zeros(width)
    values[noisy] = -direction[:-1] / direction[-1] / sizes[noisy]
    right_side = R[:k, -1] - R[:k, k:-1] @ values[noisy]
    values[exact] = solve_triangular(R[:k, :k], right_side) if k else 0.0
    return values, least
