"""The data of a fit, reduced to one triangular factor an actuator.

R_i of [W_i | τ_i] = Q_i R_i holds all that least squares needs of the samples of actuator i, for
any weights between actuators, however long the log was.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, finite, frozen
from loopid.errors import DataError
from loopid.parameters import ParameterSet
from loopid.regressors.observation import triangular_factor


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
    samples : int
        Samples of each actuator.
    mean_force : FloatArray
        (dof,) in N or N m.
    """

    parameters: ParameterSet
    actuators: tuple[str, ...]
    factors: FloatArray
    samples: int
    mean_force: FloatArray

    @classmethod
    def from_samples(
        cls,
        regressor: FloatArray,
        force: FloatArray,
        parameters: ParameterSet,
        actuators: Sequence[str],
    ) -> FitProblem:
        """Reduce samples.

        Parameters
        ----------
        regressor : FloatArray
            (N, dof, n) in N or N m per unit parameter.
        force : FloatArray
            (N, dof) in N or N m.
        """
        W, tau = finite(regressor, "regressor"), finite(force, "force")
        expected = (len(actuators), len(parameters))
        if W.ndim != 3 or W.shape[1:] != expected:
            raise DataError(f"the regressor must have shape (samples, *{expected}), not {W.shape}")
        if tau.shape != W.shape[:2]:
            raise DataError(f"force must have shape {W.shape[:2]}, not {tau.shape}")
        if len(W) == 0:
            raise DataError("there are no samples to fit")
        augmented = np.concatenate([W, tau[:, :, None]], axis=2).transpose(1, 0, 2)
        factors = frozen(triangular_factor(augmented))
        mean = frozen(tau.mean(axis=0))
        return cls(parameters, tuple(actuators), factors, len(W), mean)

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
        samples = sum(part.samples for part in parts)
        mean = sum(part.samples * part.mean_force for part in parts) / samples
        return cls(first.parameters, first.actuators, frozen(factors), samples, frozen(mean))

    def residual_squares(self, values: FloatArray) -> FloatArray:
        """Sums of squared residuals (dof,) of each actuator at parameter values (n,)."""
        residual = self.factors @ np.append(values, -1.0)
        return np.asarray((residual**2).sum(axis=1), dtype=np.float64)

    def total_squares(self) -> FloatArray:
        """Sums of squared deviations (dof,) of each force from its mean."""
        about_zero = (self.factors[:, :, -1] ** 2).sum(axis=1)
        return np.asarray(about_zero - self.samples * self.mean_force**2, dtype=np.float64)
