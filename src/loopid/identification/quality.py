"""How well parameters explain forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray, finite, frozen
from loopid.errors import DataError
from loopid.identification.comparison import ComparedByFields
from loopid.identification.problem import FitProblem

# Squared deviation of a force from its mean, relative to its square, that is but round-off.
CONSTANT_FORCE = 1e-12


@dataclass(frozen=True, eq=False)
class Quality(ComparedByFields):
    """Residuals of parameters on data, an actuator each; NaN where it has no samples.

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
    unexplained = np.full(len(total), np.nan)
    np.divide(squares, total, out=unexplained, where=varies)
    mean = np.full(len(total), np.nan)
    np.divide(squares, problem.samples, out=mean, where=problem.samples > 0)
    return Quality(np.sqrt(mean), 1.0 - unexplained, problem.samples)
