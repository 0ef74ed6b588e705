"""Ordinary least squares: errors of one variance for all actuators."""

from __future__ import annotations

from loopid.identification.estimator import Estimator
from loopid.identification.least_squares import equal_weights, result_of, solved
from loopid.identification.problem import FitProblem
from loopid.identification.result import FitResult
from loopid.records import record


@record
class OrdinaryLeastSquares(Estimator):
    """All actuators count alike."""

    name = "ols"

    def _fit(self, problem: FitProblem) -> FitResult:
        weights = equal_weights(problem)
        values, R = solved(problem, weights)
        variance = problem.residual_squares(values).sum() / problem.freedom
        return result_of(self.name, problem, values, R, weights, variance)
