"""How the errors of a fit follow one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, IntArray, frozen
from loopid.identification.comparison import ComparedByFields


@dataclass(frozen=True, eq=False)
class NoiseModel(ComparedByFields):
    """An autoregressive model of each actuator's errors, e_t = Σ c_k e_{t-k} + ε_t.

    Actuators without samples have NaN for all that is not a count.

    Attributes
    ----------
    actuators : tuple of str
    coefficients : FloatArray
        (dof, order), c_k, padded with zeros; order 0 for errors that are all independent.
    innovation : FloatArray
        (dof,), standard deviation of ε in N or N m.
    deviation : FloatArray
        (dof,), standard deviation of e in N or N m.
    lag_one : FloatArray
        (dof,), correlation of neighbouring errors.
    samples : IntArray
        (dof,).
    effective_samples : FloatArray
        (dof,), how many independent samples would tell a mean as well; at most ``samples``.
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
        """How many earlier errors each model looks back on (dof,)."""
        width = self.coefficients.shape[1]
        places = np.where(self.coefficients != 0, np.arange(1, width + 1), 0)
        return np.asarray(places.max(axis=1, initial=0), dtype=np.int64)
