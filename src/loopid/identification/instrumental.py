"""Instrumental variables: unbiased where positions are noisy [Janot2014].

Errors of measured positions are in the regressor X too, so that least squares is biased.
Instruments Z, the regressor of a motion whose errors are independent of these, give ZᵀX φ = Zᵀy
instead. With the projection X̂ = Z (ZᵀZ)⁻¹ ZᵀX of X on Z, these are the least squares of y on X̂
[Soderstrom1989]: working samples are X̂ and X̂φ + r, with the residuals r of X itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from loopid.arguments import checked_fields
from loopid.arrays import FloatArray
from loopid.errors import OptionError, RankError
from loopid.identification.least_squares import (
    SampleEstimator,
    WorkingFit,
    converged_weights,
    equal_weights,
    require_excitation,
    require_rows,
    result_of,
)
from loopid.identification.problem import FitProblem, FitSamples
from loopid.scratch import mapped_rows, row_blocks
from loopid.threads import one_blas_thread
from loopid.triangular import triangular_factor

# Statistic F of the regression of the regressor on the instruments, in the direction that these
# determine least, below which they are too weak for intervals to hold [Staiger1997].
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
    >>> loopid.fit(samples, loopid.InstrumentalVariables()).values.round(1).tolist()
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
                found = Projection(problem, factors, weights)
                return found.values, found.leverages()

            weights = (
                converged_weights(problem, fitted) if self.weighted else equal_weights(problem)
            )
            found = Projection(problem, factors, weights)
        values, turn, variance = found.values, np.linalg.solve(found.own, found.shared), 1.0
        if not self.weighted:
            variance = float(weights**2 @ problem.residual_squares(values)) / problem.freedom
        result = result_of(self.name, problem, values, found.shared, weights, variance)
        X, residual = mapped_rows(lambda rows: Z[rows] @ turn, len(Z)), samples.residual(values)
        force = mapped_rows(lambda rows: X[rows] @ values + residual[rows], len(Z))
        return WorkingFit(result, replace(samples, regressor=X, force=force))


class Projection:
    """The weighted regressor X on the instruments Z, by the factors of [Z | X | y].

    ``own`` (n, n) is the triangular factor of the instruments, Z = Q Rz; ``shared`` (n, n) is
    P = Qᵀ X, so that X̂ = Q P; ``values`` (n,) are the estimates.
    """

    def __init__(self, problem: FitProblem, factors: FloatArray, weights: FloatArray) -> None:
        width, size = len(problem.parameters), factors.shape[-1]
        self._rows = weights[:, None, None] * factors
        whole = triangular_factor(self._rows.reshape(-1, size))
        self.own, self.shared = whole[:width, :width], whole[:width, width:-1]
        R = triangular_factor(whole[:, width:-1])
        for part in (self.own, self.shared, R):
            require_excitation(problem, part)
        cosine = float(np.linalg.svd(self.shared @ np.linalg.inv(R), compute_uv=False)[-1])
        unexplained = max(1.0 - cosine**2, np.finfo(float).eps)
        strength = problem.freedom / width * cosine**2 / unexplained
        if strength < LEAST_STRENGTH:
            raise RankError(
                f"the instruments are too weak: F statistic {strength:.2g} of the combination of "
                f"parameters that they determine least (least {LEAST_STRENGTH:g}); are they of "
                "the same motion?"
            )
        self.values = np.asarray(np.linalg.solve(self.shared, whole[:width, -1]), dtype=np.float64)

    def leverages(self) -> FloatArray:
        """Part of the parameters (dof,) that each actuator determines, tr Xᵢ (ZᵀX)⁻¹ Zᵢᵀ."""
        width = len(self.own)
        Z = self._rows[:, :, :width] @ np.linalg.inv(self.own)
        X = self._rows[:, :, width:-1] @ np.linalg.inv(self.shared)
        return np.asarray((Z * X).sum(axis=(1, 2)), dtype=np.float64)


def _joint_factors(samples: FitSamples, instruments: FloatArray) -> FloatArray:
    """Triangular factors (dof, 2n + 1, 2n + 1) of [Z | X | y], an actuator each."""
    dof, width = len(samples.actuators), 2 * len(samples.parameters) + 1
    factors = np.zeros((dof, width, width))
    for rows in row_blocks(len(samples)):
        parts = instruments[rows], samples.regressor[rows], samples.force[rows][:, :, None]
        block = np.concatenate(parts, axis=2) * samples.used[rows][:, :, None]
        factors = triangular_factor(np.concatenate([factors, block.transpose(1, 0, 2)], axis=1))
    return factors
