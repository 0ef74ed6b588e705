"""What a fit found, and how far to trust it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError, OptionError
from loopid.identification.comparison import ComparedByFields
from loopid.identification.estimate import Estimate
from loopid.identification.noise import NoiseModel
from loopid.identification.problem import FitProblem
from loopid.identification.quality import Quality, fit_quality
from loopid.identification.robustness import Robustness
from loopid.parameters import ParameterSet

# Fewer degrees of freedom tell no interval.
LEAST_FREEDOM = 1.0


@dataclass(frozen=True, eq=False)
class FitResult(ComparedByFields):
    """Estimated parameters with their uncertainty.

    Attributes
    ----------
    estimator : str
    parameters : ParameterSet
    actuators : tuple of str
    values : FloatArray
        (n,).
    covariance : FloatArray
        (n, n), for the errors of ``noise``, or independent ones where that is None.
    condition_number : float
        Of the weighted regressor.
    degrees_of_freedom : float
        Of Student's distribution: rows, or effective samples where errors are correlated, less
        parameters.
    quality : Quality
        On the data that were fitted.
    weights : FloatArray
        (dof,), of the actuators' residuals; 0 without samples.
    noise : NoiseModel or None
        How the errors follow one another.
    assumed : tuple of str
        Names of parameters that the data alone do not determine, whose values rest on what was
        assumed of them: their intervals are infinite.
    robustness : Robustness or None
        What a robust estimator made of the samples.
    """

    estimator: str
    parameters: ParameterSet
    actuators: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    condition_number: float
    degrees_of_freedom: float
    quality: Quality
    weights: FloatArray
    noise: NoiseModel | None = None
    assumed: tuple[str, ...] = ()
    robustness: Robustness | None = None

    def __post_init__(self) -> None:
        for name in ("values", "covariance", "weights"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name in self.assumed:
            if name not in self.parameters.labels:
                raise OptionError.unknown("assumed parameter", name, self.parameters.labels)

    @property
    def standard_errors(self) -> FloatArray:
        """Standard deviations (n,) of the estimates."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)

    @property
    def relative_std(self) -> FloatArray:
        """Standard errors (n,) in % of the estimates; infinite for an estimate of zero."""
        return relative_deviation(self.standard_errors, self.values)

    def intervals(self, level: float = 0.95) -> FloatArray:
        """Confidence intervals (n, 2) at a level between 0 and 1, by Student's distribution.

        Infinite where fewer than one degree of freedom is left, as such data tell values at best,
        and for parameters that are assumed.
        """
        from scipy.special import stdtrit  # here, as it takes a while to import

        if not 0 < level < 1:
            raise OptionError(f"level must be between 0 and 1, not {level}")
        reach = np.full(len(self.values), np.inf)
        if self.degrees_of_freedom >= LEAST_FREEDOM:
            reach = stdtrit(self.degrees_of_freedom, 0.5 + level / 2) * self.standard_errors
        reach[[name in self.assumed for name in self.parameters.labels]] = np.inf
        return np.stack([self.values - reach, self.values + reach], axis=1)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """All numbers about each parameter."""
        columns = (self.values, self.standard_errors, self.relative_std, self.intervals())
        return tuple(
            Estimate(k, p.label, p.unit, float(x), float(s), float(r), (float(i[0]), float(i[1])))
            for k, (p, x, s, r, i) in enumerate(zip(self.parameters, *columns, strict=True), 1)
        )

    def unsupported(self, limit: float | None = None) -> tuple[str, ...]:
        """Names of the parameters that the data hardly support.

        Those whose relative standard deviation is above a limit in %; without a limit, those whose
        95 % interval includes zero, which is a limit of about 50 %.
        """
        if limit is None:
            low, high = self.intervals().T
            weak = (low <= 0) & (high >= 0)
        elif limit > 0:
            weak = self.relative_std > limit
        else:
            raise OptionError(f"the limit must be above 0 %, not {limit}")
        labels = self.parameters.labels
        return tuple(labels[j] for j in np.flatnonzero(weak))

    def predict(self, regressor: FloatArray) -> FloatArray:
        """Forces (..., dof) of a regressor (..., dof, n)."""
        W = finite(regressor, "regressor")
        dof, n = len(self.actuators), len(self.parameters)
        if W.shape[-2:] != (dof, n):
            raise DataError(f"the regressor must have shape (..., {dof}, {n}), not {W.shape}")
        return np.asarray(W @ self.values, dtype=np.float64)

    def validate(self, problem: FitProblem) -> Quality:
        """Quality on other data than were fitted."""
        if problem.parameters != self.parameters or problem.actuators != self.actuators:
            raise DataError("validation data must have the parameters and actuators of the fit")
        return fit_quality(problem, self.values)

    def __str__(self) -> str:
        return "\n".join(str(estimate) for estimate in self.estimates)


def relative_deviation(errors: FloatArray, values: FloatArray) -> FloatArray:
    """Standard errors (n,) in % of values (n,); infinite for a value of zero."""
    size = np.abs(values)
    relative = np.full(len(size), np.inf)
    np.divide(100 * errors, size, out=relative, where=size > 0)
    return relative
