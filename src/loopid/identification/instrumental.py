"""Instrumental variables, for noisy positions: errors of the regressor bias least squares.

Instruments Z are the regressor of a motion whose errors are independent of those of the regressor
X. They give ZᵀX φ = Zᵀy [Janot2014]. With the projection X̂ = Z (ZᵀZ)⁻¹ ZᵀX of X on Z, these are
the least squares of y on X̂ [Soderstrom1989]. Working samples are X̂ and X̂φ + r, with the
residuals r of X itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import OptionError, RankError
from loopid.identification.estimator import (
    Estimator,
    WorkingFit,
    converged_weights,
    require_excitation,
    require_rows,
    result_of,
)
from loopid.identification.problem import FitProblem, FitSamples
from loopid.observation import triangular_factor
from loopid.records import record
from loopid.workers import one_blas_thread

# Statistic F of the regression of the regressor on the instruments, in the direction that these
# determine least, below which they are too weak for intervals to hold [Staiger1997].
LEAST_STRENGTH = 10.0


@record(checked=True)
class InstrumentalVariables(Estimator):
    """Estimates by instruments, which the samples bring (``FitSamples.with_instruments``).

    Each actuator counts by its own error variance, as in weighted least squares.

    Examples
    --------
    A measured regressor with errors, and that of the commanded motion as instruments:

    >>> import loopid, numpy as np
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(5000, 1, 2))
    >>> force = W @ [2.0, 0.5] + 0.1 * rng.normal(size=(5000, 1))
    >>> measured = W + 0.3 * rng.normal(size=W.shape)
    >>> samples = loopid.identification.FitSamples.of(names, ["motor"], measured, force)
    >>> samples = samples.with_instruments(W)
    >>> loopid.identification.fit(samples, "iv").values.round(1).tolist()
    [2.0, 0.5]
    """

    name = "iv"

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
            # Of [Z | X | y], an actuator each.
            both = replace(samples, regressor=Z).beside("measured", samples.regressor)
            factors = both.problem.factors

            def fitted(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
                rows = weights[:, None, None] * factors
                own, shared, values = self._projection(problem, rows)
                # Leverages are tr Xᵢ (ZᵀX)⁻¹ Zᵢᵀ.
                columns = rows[:, :, : len(own)] @ np.linalg.inv(own)
                leverage = columns * (rows[:, :, len(own) : -1] @ np.linalg.inv(shared))
                return values, leverage.sum(axis=(1, 2))

            weights = converged_weights(problem, fitted)
            own, shared, values = self._projection(problem, weights[:, None, None] * factors)
            result = result_of(self.name, problem, values, shared, weights, 1.0)
        turn, residual = np.linalg.solve(own, shared), samples.residual(values)
        X = Z @ turn
        return WorkingFit(result, replace(samples, regressor=X, force=X @ values + residual))

    def _projection(
        self, problem: FitProblem, rows: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
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
                f"parameters that they determine least (least {LEAST_STRENGTH:g}); are they "
                "of the same motion?",
                strength=strength,
                least=LEAST_STRENGTH,
            )
        return own, shared, np.asarray(np.linalg.solve(shared, whole[:width, -1]), dtype=np.float64)
