"""Instrumental variables: unbiased where positions are noisy [Janot2014].

Errors of measured positions are in the regressor X too, so that least squares is biased.
Instruments Z, the regressor of a motion that knows nothing of these errors, give ZᵀX φ = Zᵀy
instead. With the projection X̂ = Z (ZᵀZ)⁻¹ ZᵀX of X on Z, these are the least squares of y on X̂
[Soderstrom1989]: working samples are X̂ and X̂φ + r, with the residuals r of X itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray
from loopid.errors import OptionError, RankError
from loopid.identification.estimator import (
    SampleEstimator,
    WorkingFit,
    freedom_of,
    require_rows,
    result_of,
)
from loopid.identification.excitation import require_excitation
from loopid.identification.least_squares import (
    WEIGHT_ITERATIONS,
    equal_weights,
    inverse_deviations,
    settled,
    unsettled,
)
from loopid.identification.problem import FitProblem
from loopid.identification.samples import FitSamples
from loopid.scratch import mapped_rows, row_blocks
from loopid.threads import one_blas_thread
from loopid.triangular import triangular_factor

# Statistic F of the regression of the regressor on the instruments, in the direction that they tell
# least, below which they are too weak for intervals to hold [Staiger1997].
LEAST_STRENGTH = 10.0


@checked_fields
@dataclass(frozen=True)
class InstrumentalVariables(SampleEstimator):
    """Estimates by instruments, which the samples bring (``FitSamples.with_instruments``).

    Attributes
    ----------
    weighted : bool
        Whether each actuator counts by its own error variance, as in weighted least squares, or all
        alike.
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
            When the instruments do not tell a combination of parameters, or hardly.
        """
        if samples.instruments is None:
            raise OptionError(
                "iv needs instruments, the regressor of a motion that knows nothing of the errors: "
                "pass samples.with_instruments(instruments)"
            )
        require_rows(samples.problem)
        with one_blas_thread():
            factors = _joint_factors(samples, samples.instruments)
            return _working_fit(samples, self._projection(samples.problem, factors), self.weighted)

    def _projection(self, problem: FitProblem, factors: FloatArray) -> Projected:
        """The regressor on the instruments, with the weights that suit the residuals."""
        weights = equal_weights(problem)
        for _ in range(WEIGHT_ITERATIONS if self.weighted else 1):
            found = Projected(problem, factors, weights)
            found.require_strength()
            if not self.weighted:
                return found
            squares = problem.residual_squares(found.values)
            last = weights
            weights = inverse_deviations(problem, squares, problem.samples - found.leverages)
            if settled(weights, last):
                return Projected(problem, factors, weights)
        raise unsettled()


@dataclass(frozen=True)
class Projected:
    """Weighted rows [Z | X | y] of all actuators, by their triangular factors.

    Attributes
    ----------
    problem : FitProblem
    factors : FloatArray
        (dof, 2n + 1, 2n + 1).
    weights : FloatArray
        (dof,).
    """

    problem: FitProblem
    factors: FloatArray
    weights: FloatArray

    @cached_property
    def whole(self) -> FloatArray:
        """The factor (2n + 1, 2n + 1) of all actuators."""
        stacked = self.weights[:, None, None] * self.factors
        return triangular_factor(stacked.reshape(-1, stacked.shape[-1]))

    @cached_property
    def width(self) -> int:
        """Number n of parameters."""
        return len(self.problem.parameters)

    @property
    def own(self) -> FloatArray:
        """Triangular factor (n, n) of the instruments, Z = Q Rz."""
        return self.whole[: self.width, : self.width]

    @property
    def shown(self) -> FloatArray:
        """P = Qᵀ X (n, n): the projection of the regressor is X̂ = Q P."""
        return self.whole[: self.width, self.width : -1]

    @property
    def values(self) -> FloatArray:
        """Estimates (n,)."""
        return np.asarray(np.linalg.solve(self.shown, self.whole[: self.width, -1]))

    @property
    def turn(self) -> FloatArray:
        """T (n, n) with X̂ = Z T."""
        return np.asarray(np.linalg.solve(self.own, self.shown))

    @property
    def leverages(self) -> FloatArray:
        """Part of the parameters (dof,) that each actuator determines, tr Xᵢ (ZᵀX)⁻¹ Zᵢᵀ."""
        rows = self.weights[:, None, None] * self.factors
        Z = rows[:, :, : self.width] @ np.linalg.inv(self.own)
        X = rows[:, :, self.width : -1] @ np.linalg.inv(self.shown)
        return np.asarray((Z * X).sum(axis=(1, 2)), dtype=np.float64)

    def require_strength(self) -> None:
        """Refuse instruments that tell columns not apart, or hardly follow them."""
        require_excitation(self.problem, self.own)
        require_excitation(self.problem, self.shown)
        R = triangular_factor(self.whole[:, self.width : -1])
        require_excitation(self.problem, R)
        cosine = float(np.linalg.svd(self.shown @ np.linalg.inv(R), compute_uv=False)[-1])
        rows = self.problem.rows - self.width
        strength = rows / self.width * cosine**2 / max(1.0 - cosine**2, np.finfo(float).eps)
        if strength < LEAST_STRENGTH:
            raise RankError(
                f"the instruments hardly follow the regressor: F statistic {strength:.2g} of the "
                f"combination that they tell least (least {LEAST_STRENGTH:g}); are they of the "
                "same motion?"
            )


def _joint_factors(samples: FitSamples, instruments: FloatArray) -> FloatArray:
    """Triangular factors (dof, 2n + 1, 2n + 1) of [Z | X | y], an actuator each."""
    dof, width = len(samples.actuators), 2 * len(samples.parameters) + 1
    factors = np.zeros((dof, width, width))
    for rows in row_blocks(len(samples)):
        parts = instruments[rows], samples.regressor[rows], samples.force[rows][:, :, None]
        block = np.concatenate(parts, axis=2) * samples.used[rows][:, :, None]
        factors = triangular_factor(np.concatenate([factors, block.transpose(1, 0, 2)], axis=1))
    return factors


def _working_fit(samples: FitSamples, found: Projected, weighted: bool) -> WorkingFit:
    problem, values, turn = samples.problem, found.values, found.turn
    squares = float(found.weights**2 @ problem.residual_squares(values))
    variance = 1.0 if weighted else squares / freedom_of(problem)
    result = result_of("iv", problem, values, found.shown, found.weights, variance)
    assert samples.instruments is not None
    Z = samples.instruments
    X = mapped_rows(lambda rows: Z[rows] @ turn, len(samples))
    residual = samples.residual(values)
    force = mapped_rows(lambda rows: X[rows] @ values + residual[rows], len(samples))
    return WorkingFit(result, replace(samples, regressor=X, force=force))
