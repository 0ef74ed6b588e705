"""What a reduction found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, frozen
from loopid.identification import FitResult
from loopid.parameters import ParameterSet


@dataclass(frozen=True, eq=False)
class ReductionStep:
    """A fit of some of the parameters, the others at their reference.

    Errors are mean squares in units of the error variance of the full model, each actuator's own.

    Attributes
    ----------
    labels : tuple of str
        Names that are fitted.
    dropped : str or None
        Name that was dropped on the way here.
    relative_std : float
        Of the dropped one, in % of its distance from its reference, in the step before; NaN where
        none was dropped.
    values : FloatArray
        (n,).
    training_rms, validation_rms : FloatArray
        (dof,) in N or N m; NaN without samples.
    training_error, validation_error : float
        Over all actuators.
    standard_error : float
        Of ``validation_error``.
    excess, excess_error : float
        Of ``validation_error`` over that of the best step, and its standard error; 0 for the best.
    """

    labels: tuple[str, ...]
    dropped: str | None
    relative_std: float
    values: FloatArray
    training_rms: FloatArray
    validation_rms: FloatArray
    training_error: float
    validation_error: float
    standard_error: float
    excess: float = 0.0
    excess_error: float = 0.0

    def __post_init__(self) -> None:
        for name in ("values", "training_rms", "validation_rms"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Reduction:
    """The parameters that data support.

    Attributes
    ----------
    parameters : ParameterSet
        All n.
    reference : FloatArray
        (n,), values of parameters that are dropped.
    steps : tuple of ReductionStep
        From all parameters to the fewest.
    chosen : ReductionStep
        With the fewest parameters of those whose validation error is not clearly above the least.
    result : FitResult
        Of the supported parameters; forces of the others are taken away before.
    """

    parameters: ParameterSet
    reference: FloatArray
    steps: tuple[ReductionStep, ...]
    chosen: ReductionStep
    result: FitResult

    def __post_init__(self) -> None:
        object.__setattr__(self, "reference", frozen(self.reference))

    @property
    def supported(self) -> int:
        """Number of parameters that the data support."""
        return len(self.result.parameters)

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the supported parameters among all."""
        return tuple(self.parameters.labels.index(label) for label in self.result.parameters.labels)

    @property
    def values(self) -> FloatArray:
        """All parameters (n,): as fitted where supported, the reference elsewhere."""
        values = self.reference.copy()
        values[list(self.columns)] = self.result.values
        return values

    @property
    def covariance(self) -> FloatArray:
        """Of all parameters (n, n), zero where the reference stands."""
        covariance = np.zeros((len(self.parameters), len(self.parameters)))
        covariance[np.ix_(self.columns, self.columns)] = self.result.covariance
        return covariance
