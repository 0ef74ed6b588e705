"""What a fit found, and how far to trust it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from loopid.arrays import FloatArray, finite
from loopid.errors import DataError, OptionError
from loopid.identification.problem import FitProblem
from loopid.parameters import ParameterSet


@dataclass(frozen=True)
class Quality:
    """How well parameters explain forces, an actuator each.

    Attributes
    ----------
    residual_rms : FloatArray
        (dof,) in N or N m.
    r_squared : FloatArray
        (dof,), 1 - residual over total squares about the mean; negative when worse than the mean.
    """

    residual_rms: FloatArray
    r_squared: FloatArray


@dataclass(frozen=True)
class FitResult:
    """Estimated parameters with their uncertainty.

    Attributes
    ----------
    estimator : str
    parameters : ParameterSet
    actuators : tuple of str
    values : FloatArray
        (n,).
    covariance : FloatArray
        (n, n), under independent errors.
    condition_number : float
        Of the weighted regressor.
    degrees_of_freedom : int
        Rows less parameters.
    quality : Quality
        On the data that were fitted.
    """

    estimator: str
    parameters: ParameterSet
    actuators: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    condition_number: float
    degrees_of_freedom: int
    quality: Quality

    @property
    def standard_errors(self) -> FloatArray:
        """Standard deviations (n,) of the estimates."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)

    @property
    def relative_std(self) -> FloatArray:
        """Standard errors (n,) in % of the estimates; infinite for an estimate of zero."""
        size = np.abs(self.values)
        relative = np.full(len(size), np.inf)
        np.divide(100 * self.standard_errors, size, out=relative, where=size > 0)
        return relative

    def intervals(self, level: float = 0.95) -> FloatArray:
        """Confidence intervals (n, 2) at a level between 0 and 1, by Student's distribution."""
        if not 0 < level < 1:
            raise OptionError(f"level must be between 0 and 1, not {level}")
        reach = student.ppf(0.5 + level / 2, self.degrees_of_freedom) * self.standard_errors
        return np.stack([self.values - reach, self.values + reach], axis=1)

    def predict(self, regressor: FloatArray) -> FloatArray:
        """Forces (..., dof) of a regressor (..., dof, n)."""
        W = finite(regressor, "regressor")
        expected = (len(self.actuators), len(self.parameters))
        if W.shape[-2:] != expected:
            raise DataError(f"the regressor must have shape (..., *{expected}), not {W.shape}")
        return np.asarray(W @ self.values, dtype=np.float64)

    def validate(self, problem: FitProblem) -> Quality:
        """Quality on other data than were fitted."""
        if problem.parameters != self.parameters or problem.actuators != self.actuators:
            raise DataError("validation data must have the parameters and actuators of the fit")
        return fit_quality(problem, self.values)


def fit_quality(problem: FitProblem, values: FloatArray) -> Quality:
    """Residuals of a problem at parameter values (n,)."""
    squares, total = problem.residual_squares(values), problem.total_squares()
    explained = np.full(len(total), np.nan)
    np.divide(squares, total, out=explained, where=total > 0)
    return Quality(np.sqrt(squares / problem.samples), 1.0 - explained)
