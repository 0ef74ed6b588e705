"""How well parameters explain the forces, and what the residuals look like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import ComparedByFields, FloatArray, IntArray, finite, frozen
from loopid.errors import DataError
from loopid.identification.problem import FitProblem

# Squared deviation of a force from its mean, relative to its square, that is but round-off.
CONSTANT_FORCE = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class Quality(ComparedByFields):
    """Residuals of parameters on data, by actuator; NaN where it has no samples.

    Attributes
    ----------
    residual_rms : FloatArray
        (dof,) in N or N m.
    r_squared : FloatArray
        (dof,), 1 - residual over total squares about the mean; negative when worse than the mean,
        NaN for a constant force.
    samples : IntArray
        (dof,).
    """

    residual_rms: FloatArray
    r_squared: FloatArray
    samples: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "residual_rms", frozen(self.residual_rms))
        object.__setattr__(self, "r_squared", frozen(self.r_squared))
        object.__setattr__(self, "samples", frozen(self.samples, np.int64))


@dataclass(frozen=True, eq=False, repr=False)
class NoiseModel(ComparedByFields):
    """An autoregressive model of each actuator's errors, e_t = Σ c_k e_{t-k} + ε_t.

    Actuators without samples have NaN for all that is not a count.

    Attributes
    ----------
    actuators : tuple of str
    coefficients : FloatArray
        (dof, order), c_k, padded with zeros; order 0 when the errors of all are independent.
    innovation : FloatArray
        (dof,), standard deviation of ε in N or N m.
    deviation : FloatArray
        (dof,), standard deviation of e in N or N m.
    lag_one : FloatArray
        (dof,), correlation of neighbouring errors.
    samples : IntArray
        (dof,).
    effective_samples : FloatArray
        (dof,), number of independent samples that would determine a mean as well; at most
        ``samples``.
    """

    actuators: tuple[str, ...]
    coefficients: FloatArray
    innovation: FloatArray
    deviation: FloatArray
    lag_one: FloatArray
    samples: IntArray
    effective_samples: FloatArray

    def __post_init__(self) -> None:
        for name in ("coefficients", "innovation", "deviation", "lag_one", "effective_samples"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "samples", frozen(self.samples, np.int64))

    @property
    def orders(self) -> IntArray:
        """Order of each actuator's model (dof,)."""
        places = np.where(self.coefficients != 0, 1 + np.arange(self.coefficients.shape[1]), 0)
        return np.asarray(places.max(axis=1, initial=0), dtype=np.int64)


@dataclass(frozen=True, eq=False, repr=False)
class Robustness(ComparedByFields):
    """Scale and weights of the residuals of a robust fit, by actuator; NaN without samples.

    Attributes
    ----------
    scale : FloatArray
        (dof,) in N or N m, standard deviation of errors without outliers, from the median.
    down_weighted : FloatArray
        (dof,), share of the samples that count less than half: some 1 % of normal errors.
    """

    scale: FloatArray
    down_weighted: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", frozen(self.scale))
        object.__setattr__(self, "down_weighted", frozen(self.down_weighted))


@checked
def fit_quality(problem: FitProblem, values: FloatArray) -> Quality:
    """Residuals of a problem at parameter values (n,).

    Raises
    ------
    DataError
        When the values are not n finite numbers.
    """
    phi, width = finite(values, "values"), len(problem.parameters)
    if phi.shape != (width,):
        raise DataError(f"values must have shape ({width},), not {phi.shape}")
    squares, total = problem.residual_squares(phi), problem.total_squares()
    varies = total > CONSTANT_FORCE * problem.force_squares()
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(problem.samples > 0, squares / problem.samples, np.nan)
        r_squared = np.where(varies, 1.0 - squares / total, np.nan)
    return Quality(np.sqrt(mean), r_squared, problem.samples)
