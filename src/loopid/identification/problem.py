"""The data of a fit, reduced to one triangular factor an actuator.

R_i of [W_i | τ_i] = Q_i R_i holds all that least squares needs of the samples of actuator i, for
any weights between actuators, however long the log was. Factors of parts of a log, stacked and
factored again, are those of the whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from loopid.arguments import checked
from loopid.arrays import BoolArray, FloatArray, IntArray, frozen
from loopid.errors import DataError
from loopid.identification.checks import checked_least_errors, checked_mask, checked_samples
from loopid.parameters import ParameterSet
from loopid.scratch import row_blocks
from loopid.triangular import triangular_factor


@dataclass(frozen=True)
class FitProblem:
    """Forces and regressors of several actuators over samples.

    Attributes
    ----------
    parameters : ParameterSet
        The n parameters to be found.
    actuators : tuple of str
    factors : FloatArray
        (dof, n + 1, n + 1), triangular factors of [W_i | τ_i], read-only.
    samples : IntArray
        (dof,), samples of each actuator that take part; may be 0.
    mean_force : FloatArray
        (dof,) in N or N m, over these samples; 0 where there are none.
    least_errors : FloatArray
        (dof,) in N or N m, deviation below which errors count as round-off; 0 for none.
    """

    parameters: ParameterSet
    actuators: tuple[str, ...]
    factors: FloatArray
    samples: IntArray
    mean_force: FloatArray
    least_errors: FloatArray

    @classmethod
    @checked
    def from_samples(
        cls,
        regressor: FloatArray,
        force: FloatArray,
        parameters: ParameterSet,
        actuators: Sequence[str],
        used: BoolArray | None = None,
        least_errors: FloatArray | None = None,
    ) -> FitProblem:
        """Reduce samples, block by block.

        Parameters
        ----------
        regressor : FloatArray
            (N, dof, n) in N or N m per unit parameter.
        force : FloatArray
            (N, dof) in N or N m.
        used : BoolArray, optional
            (N, dof), which forces take part; by default all.
        least_errors : FloatArray, optional
            (dof,), by default 0.
        """
        W, tau = checked_samples(regressor, force, parameters, actuators)
        mask = checked_mask(used, tau)
        least = frozen(checked_least_errors(least_errors, len(actuators)))
        return cls.combined(
            cls._of_block(W[rows], tau[rows], mask[rows], (parameters, tuple(actuators), least))
            for rows in row_blocks(len(tau))
        )

    @classmethod
    def _of_block(
        cls,
        W: FloatArray,
        tau: FloatArray,
        mask: BoolArray,
        common: tuple[ParameterSet, tuple[str, ...], FloatArray],
    ) -> FitProblem:
        """Reduce samples at once; parameters, actuators and least errors are common to all."""
        parameters, actuators, least = common
        augmented = np.concatenate([W, tau[:, :, None]], axis=2) * mask[:, :, None]
        factors = triangular_factor(augmented.transpose(1, 0, 2))
        counts = mask.sum(axis=0)
        mean = (tau * mask).sum(axis=0) / np.maximum(counts, 1)
        numbers = frozen(counts, np.int64), frozen(mean), least
        return cls(parameters, actuators, frozen(factors), *numbers)

    @classmethod
    def combined(cls, problems: Iterable[FitProblem]) -> FitProblem:
        """All samples of several problems, such as parts of a log, with one in memory at a time.

        The order counts in round-off only.
        """
        parts = iter(problems)
        first = next(parts, None)
        if first is None:
            raise DataError("there are no problems to combine")
        return reduce(cls.merge, parts, first)

    def merge(self, other: FitProblem) -> FitProblem:
        """The samples of both."""
        if (self.parameters, self.actuators) != (other.parameters, other.actuators):
            raise DataError("problems to combine must share their parameters and actuators")
        factors = triangular_factor(np.concatenate([self.factors, other.factors], axis=1))
        counts = self.samples + other.samples
        total = self.samples * self.mean_force + other.samples * other.mean_force
        return FitProblem(
            self.parameters,
            self.actuators,
            frozen(factors),
            frozen(counts, np.int64),
            frozen(total / np.maximum(counts, 1)),
            frozen(np.maximum(self.least_errors, other.least_errors)),
        )

    @property
    def rows(self) -> int:
        """Forces that take part, of all actuators."""
        return int(self.samples.sum())

    def weighted(self, weights: FloatArray) -> FloatArray:
        """One triangular factor (n + 1, n + 1) of all actuators, each times its weight (dof,)."""
        width = self.factors.shape[-1]
        return triangular_factor((weights[:, None, None] * self.factors).reshape(-1, width))

    def residual_squares(self, values: FloatArray) -> FloatArray:
        """Sums of squared residuals (dof,) of each actuator at parameter values (n,)."""
        residual = self.factors @ np.append(values, -1.0)
        return np.asarray((residual**2).sum(axis=1), dtype=np.float64)

    def force_squares(self) -> FloatArray:
        """Sums of squared forces (dof,)."""
        return np.asarray((self.factors[:, :, -1] ** 2).sum(axis=1), dtype=np.float64)

    def total_squares(self) -> FloatArray:
        """Sums of squared deviations (dof,) of each force from its mean."""
        return self.force_squares() - self.samples * self.mean_force**2
