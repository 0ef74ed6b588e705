"""Weighted least squares: each actuator counts by its own error variance [Gautier1997]."""

from __future__ import annotations

from loopid.identification.estimator import Estimator
from loopid.identification.least_squares import (
    Convergence,
    least_squares_weights,
    result_of,
    solved,
)
from loopid.identification.problem import FitProblem
from loopid.identification.result import FitResult
from loopid.records import record


@record
class WeightedLeastSquares(Estimator):
    """The variances are found by iteration.

    Attributes
    ----------
    convergence : Convergence
    """

    name = "wls"
    convergence: Convergence = Convergence()

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = least_squares_weights(problem, convergence=self.convergence)
        values, R = solved(problem, weights)
        return result_of(self.name, problem, values, R, weights, 1.0)
