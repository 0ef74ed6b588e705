"""What a consistent fit found, and what consistency costs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from loopid.arrays import ComparedByFields, FloatArray, frozen
from loopid.consistency.record import fields_of, record_of
from loopid.identification.storage import Saved, read_record
from loopid.parameters import ParameterSet


@dataclass(frozen=True, eq=False)
class FitCost(ComparedByFields):
    """Residuals with and without the constraints.

    Attributes
    ----------
    actuators : tuple of str
    unconstrained, constrained : FloatArray
        Root mean squares (dof,) in N or N m; NaN without samples.
    total : float
        Weighted root mean square of all residuals, constrained over unconstrained.
    """

    actuators: tuple[str, ...]
    unconstrained: FloatArray
    constrained: FloatArray
    total: float

    def __post_init__(self) -> None:
        for name in ("unconstrained", "constrained"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def ratios(self) -> FloatArray:
        """Constrained over unconstrained (dof,); 1 where both are zero."""
        both = (self.unconstrained == 0) & (self.constrained == 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = self.constrained / self.unconstrained
        return np.asarray(np.where(both, 1.0, ratios), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class ConsistentFit(ComparedByFields, Saved):
    """Standard parameters that bodies can have, fitted to data.

    Attributes
    ----------
    parameters : ParameterSet
        The p standard parameters, terms of joints included.
    standard_parameters : FloatArray
        (p,), pseudo-inertias positive definite.
    base_parameters : ParameterSet
        Leading parameters of the r base parameters.
    values : FloatArray
        Base parameters (r,) of the standard ones.
    feasible : bool
        Whether there are bodies with exactly the base parameters of the unconstrained fit.
    fit_cost : FitCost
    bodies : tuple of str
    margins : FloatArray
        (bodies,), least eigenvalue of each pseudo-inertia relative to the prior's; NaN for massless
        bodies.
    boundary : tuple of str
        Bodies and terms of joints that the data pull onto the boundary of what is possible.
    repaired : tuple of str
        Bodies whose prior was repaired.
    regularisation : str
    strength, margin : float
    solver : str
        Which one found it.
    seconds : float
        What it took; not saved, so that equal runs give equal files.
    """

    parameters: ParameterSet
    standard_parameters: FloatArray
    base_parameters: ParameterSet
    values: FloatArray
    feasible: bool
    fit_cost: FitCost
    bodies: tuple[str, ...]
    margins: FloatArray
    boundary: tuple[str, ...]
    repaired: tuple[str, ...]
    regularisation: str
    strength: float
    margin: float
    solver: str
    seconds: float = field(default=np.nan, compare=False)

    def __post_init__(self) -> None:
        for name in ("standard_parameters", "values", "margins"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def rows(self) -> Iterator[dict[str, Any]]:
        """A row of a table for each body: its name, mass in kg, centre of mass in m and margin."""
        labels = self.parameters.labels
        for body, margin in zip(self.bodies, self.margins, strict=True):
            mass, *first = (
                float(self.standard_parameters[labels.index(f"{body}.{kind}")])
                for kind in ("m", "mx", "my", "mz")
            )
            centre = [moment / mass if mass else float("nan") for moment in first]
            names = ("x", "y", "z")
            yield {
                "body": body,
                "mass": mass,
                **dict(zip(names, centre, strict=True)),
                "margin": float(margin),
            }

    def record(self) -> dict[str, Any]:
        """All of it in plain numbers, lists and texts; None for what is not finite."""
        return record_of(self)

    @classmethod
    def load(cls, path: str | Path) -> ConsistentFit:
        """Read a result that was saved.

        Raises
        ------
        MissingFileError
            When there is no such file.
        DataError
            When it is no saved result.
        """
        fields = fields_of(read_record(path), path)
        return cls(**{**fields, "fit_cost": FitCost(**fields["fit_cost"])})

    def __str__(self) -> str:
        verdict = "feasible" if self.feasible else "not feasible"
        lines = [
            f"unconstrained optimum {verdict}; consistency costs "
            f"{100 * (self.fit_cost.total - 1):.2g} % of the residual rms "
            f"({self.regularisation}, strength {self.strength:g}, {self.solver})"
        ]
        for row in self.rows:
            centre = ", ".join(f"{row[axis]:.4g}" for axis in "xyz")
            lines.append(
                f"{row['body']}: {row['mass']:.4g} kg at ({centre}) m, margin {row['margin']:.2g}"
            )
        if self.boundary:
            lines.append(f"on the boundary: {', '.join(self.boundary)}")
        return "\n".join(lines)
