"""The data of a fit, reduced to one triangular factor an actuator.

R_i of [W_i | τ_i] = Q_i R_i holds all that least squares needs of the samples of actuator i, for
any weights between actuators, however long the log was.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arrays import BoolArray, FloatArray, IntArray, finite, frozen
from loopid.errors import DataError
from loopid.observation import triangular_factor
from loopid.parameters import ParameterSet


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
    def from_samples(
        cls,
        regressor: FloatArray,
        force: FloatArray,
        parameters: ParameterSet,
        actuators: Sequence[str],
        used: BoolArray | None = None,
        least_errors: FloatArray | None = None,
    ) -> FitProblem:
        """Reduce samples.

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
        augmented = np.concatenate([W, tau[:, :, None]], axis=2) * mask[:, :, None]
        factors = triangular_factor(augmented.transpose(1, 0, 2))
        counts = mask.sum(axis=0)
        mean = (tau * mask).sum(axis=0) / np.maximum(counts, 1)
        least = np.zeros(len(counts)) if least_errors is None else least_errors
        numbers = frozen(counts, np.int64), frozen(mean), frozen(least)
        return cls(parameters, tuple(actuators), frozen(factors), *numbers)

    @classmethod
    def combined(cls, problems: Iterable[FitProblem]) -> FitProblem:
        """All samples of several problems, as of the parts of one log."""
        parts = list(problems)
        if not parts:
            raise DataError("there are no problems to combine")
        first = parts[0]
        for part in parts:
            if (part.parameters, part.actuators) != (first.parameters, first.actuators):
                raise DataError("problems to combine must share their parameters and actuators")
        factors = triangular_factor(np.concatenate([part.factors for part in parts], axis=1))
        counts = np.sum([part.samples for part in parts], axis=0)
        total = np.sum([part.samples * part.mean_force for part in parts], axis=0)
        return cls(
            first.parameters,
            first.actuators,
            frozen(factors),
            frozen(counts, np.int64),
            frozen(total / np.maximum(counts, 1)),
            frozen(np.max([part.least_errors for part in parts], axis=0)),
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


def checked_samples(
    regressor: FloatArray, force: FloatArray, parameters: ParameterSet, actuators: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """A regressor (N, dof, n) and forces (N, dof) that go together."""
    W, tau = finite(regressor, "regressor"), finite(force, "force")
    expected = (len(actuators), len(parameters))
    if W.ndim != 3 or W.shape[1:] != expected:
        shape = f"(samples, {expected[0]}, {expected[1]})"
        raise DataError(f"the regressor must have shape {shape}, not {W.shape}")
    if tau.shape != W.shape[:2]:
        raise DataError(f"force must have shape {W.shape[:2]}, not {tau.shape}")
    if len(W) == 0:
        raise DataError("there are no samples to fit")
    return W, tau


def checked_mask(used: BoolArray | None, force: FloatArray) -> BoolArray:
    """Which forces (N, dof) take part; by default all."""
    mask = np.ones(force.shape, dtype=bool) if used is None else np.asarray(used)
    if mask.shape != force.shape or mask.dtype != bool:
        raise DataError(
            f"used must be booleans of shape {force.shape}, not {mask.dtype} of {mask.shape}"
        )
    return mask
