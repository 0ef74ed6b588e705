"""Bayesian ridge regression with a prior: the conjugate posterior in closed form [Gelman2013].

With weighted rows X, y of errors of variance σ², σ² unknown,

    φ | σ² ~ N(φ₀, σ² S),  1/σ² ~ Gamma(ν₀/2, ν₀/2):  φ ~ t_ν(φ̂, s² V),
    V = (XᵀX + S⁻¹)⁻¹,  φ̂ = V (Xᵀy + S⁻¹φ₀),  ν = ν₀ + N,
    ν s² = ν₀ + |y - Xφ̂|² + (φ̂ - φ₀)ᵀ S⁻¹ (φ̂ - φ₀).

Rows are weighted by the noise of their actuators, known from ν₀ samples, so that σ² is near 1 and
S is the prior covariance. Noise that is not known is found from the residuals, as in weighted least
squares: then s² = 1 and ν is what the parameters leave of N.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import solve_triangular

from loopid.arguments import checked
from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError, OptionError
from loopid.identification.correlation import with_correlated_errors
from loopid.identification.estimator import (
    Estimator,
    WorkingFit,
    leverages,
    result_of,
    whole_factor,
)
from loopid.identification.excitation import require_excitation
from loopid.identification.least_squares import (
    WEIGHT_ITERATIONS,
    equal_weights,
    inverse_deviations,
    settled,
    unsettled,
)
from loopid.identification.prior import Prior
from loopid.identification.problem import FitProblem
from loopid.identification.result import FitResult
from loopid.identification.samples import FitSamples
from loopid.threads import one_blas_thread

# Samples that a noise that is given is known as well as from.
NOISE_SAMPLES = 100.0


class BayesianRidge(Estimator):
    """Parameters from data and what was known before them; intervals are posterior ones.

    Parameters
    ----------
    prior : Prior
        Of the parameters that are fitted, and maybe of more.
    noise : FloatArray, optional
        (dof,) in N or N m, standard deviation of each actuator's errors; by default from the data,
        as in weighted least squares.
    noise_samples : float
        Samples that the noise is known as well as from, where it is given.

    Raises
    ------
    OptionError
        Without a prior.
    """

    name = "bayes"

    @checked
    def __init__(
        self,
        prior: Prior | None = None,
        noise: FloatArray | None = None,
        noise_samples: float = NOISE_SAMPLES,
    ) -> None:
        if prior is None:
            raise OptionError(
                "bayes needs what was known before the data: pass BayesianRidge(prior), "
                "as with Prior.independent(parameters, values, deviations)"
            )
        if not 0 < noise_samples < np.inf:
            raise OptionError(f"noise_samples must be above 0, not {noise_samples}")
        self.prior = prior
        self.noise = None if noise is None else frozen(finite(noise, "noise"))
        if self.noise is not None and not (self.noise > 0).all():
            raise OptionError("the noise of each actuator must be above 0")
        self.noise_samples = float(noise_samples)

    def fit(self, problem: FitProblem) -> FitResult:
        """As of ``Estimator``, for any number of samples.

        Raises
        ------
        OptionError
            When the prior does not know one of the parameters.
        DataError
            When there are no samples to tell the noise, and none is given.
        RankError
            When neither the data nor the prior tell a combination of parameters.
        """
        with one_blas_thread():
            return self._fit(problem)

    def fit_samples(self, samples: FitSamples) -> WorkingFit:
        """As of ``Estimator``; actuators count by what their samples are worth.

        Errors that follow one another would otherwise drown the prior.
        """
        rows = self.prior.of(samples.parameters).rows
        plain = WorkingFit(self.fit(samples.problem), samples, rows)
        noise = with_correlated_errors(plain).result.noise
        assert noise is not None
        worth = np.sqrt(noise.effective_samples / np.maximum(noise.samples, 1))
        if (noise.effective_samples == noise.samples).all():
            return plain
        weights = plain.result.weights * worth
        return replace(plain, result=self._posterior(samples.problem, weights, rows))

    def _fit(self, problem: FitProblem) -> FitResult:
        rows = self.prior.of(problem.parameters).rows
        return self._posterior(problem, self._weights(problem, rows), rows)

    def _weights(self, problem: FitProblem, rows: FloatArray) -> FloatArray:
        """Inverse deviations (dof,) of the noise."""
        if self.noise is not None:
            if self.noise.shape != problem.samples.shape:
                raise DataError(f"noise must have shape {problem.samples.shape}")
            return np.where(problem.samples > 0, 1.0 / self.noise, 0.0)
        if problem.rows == 0:
            raise DataError("no samples tell the noise: pass BayesianRidge(prior, noise)")
        weights = equal_weights(problem)
        for _ in range(WEIGHT_ITERATIONS):
            values, R = _solved(problem, weights, rows)
            freedom = problem.samples - leverages(problem, weights, R)
            last = weights
            weights = inverse_deviations(problem, problem.residual_squares(values), freedom)
            if settled(weights, last):
                return weights
        raise unsettled()

    def _posterior(self, problem: FitProblem, weights: FloatArray, rows: FloatArray) -> FitResult:
        values, R = _solved(problem, weights, rows)
        if self.noise is None:  # weights are such that the variance is 1
            variance, freedom = 1.0, problem.rows - float(leverages(problem, weights, R).sum())
        else:
            misfit = float(((rows @ np.append(values, -1.0)) ** 2).sum())
            squares = float(weights**2 @ problem.residual_squares(values)) + misfit
            freedom = self.noise_samples + problem.rows
            variance = (self.noise_samples + squares) / freedom
        found = result_of(self.name, problem, values, R, weights, variance)
        return replace(found, degrees_of_freedom=freedom)


def _solved(
    problem: FitProblem, weights: FloatArray, rows: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Posterior mean (n,), and the triangular factor (n, n) of data and prior."""
    width = len(problem.parameters)
    factor = whole_factor(problem, weights, rows)
    R = factor[:width, :width]
    require_excitation(problem, R)
    return np.asarray(solve_triangular(R, factor[:width, width]), dtype=np.float64), R
