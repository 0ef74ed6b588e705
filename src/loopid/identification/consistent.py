"""What a physically consistent fit found; ``loopid.diagnosis.consistent_fit`` makes one."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Any

from loopid.arguments import (
    FloatArray,
    Number,
    frozen,
)
from loopid.parameters import (
    ParameterSet,
    html_table,
)
from loopid.records import record


@record
class FitCost:
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
    total: Number

    def __post_init__(self) -> None:
        for name in ("unconstrained", "constrained"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@record
class ConsistentFit:
    """Physically consistent standard parameters, fitted to data.

    Attributes
    ----------
    parameters : ParameterSet
        The p standard parameters, joint terms included.
    standard_parameters : FloatArray
        (p,), pseudo-inertias positive definite.
    base_parameters : ParameterSet
        Leading parameters of the r base parameters.
    values : FloatArray
        Base parameters (r,) of the standard ones.
    feasible : bool
        Whether consistent parameters have exactly the base parameters of the unconstrained fit.
    fit_cost : FitCost
    bodies : tuple of str
    margins : FloatArray
        (bodies,), least eigenvalue of each pseudo-inertia relative to the prior's; NaN for massless
        bodies.
    boundary : tuple of str
        Bodies and joint terms that the data pull onto the boundary of what is consistent.
    repaired : tuple of str
        Bodies whose prior was repaired.
    regularisation : str
    strength, margin : float
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

    @property
    def rows(self) -> Iterator[dict[str, Any]]:
        """A row of a table for each body: its name, mass in kg, centre of mass in m and margin."""
        places = {label: k for k, label in enumerate(self.parameters.labels)}
        for body, margin in zip(self.bodies, self.margins, strict=True):
            own = [places[f"{body}.{kind}"] for kind in ("m", "mx", "my", "mz")]
            mass, *first = map(float, self.standard_parameters[own])
            centre = (moment / mass if mass else float("nan") for moment in first)
            row = dict(zip("xyz", centre, strict=True))
            yield {"body": body, "mass": mass, **row, "margin": float(margin)}

    def _summary(self) -> str:
        verdict = "feasible" if self.feasible else "not feasible"
        return (
            f"unconstrained optimum {verdict}; consistency costs "
            f"{100 * (self.fit_cost.total - 1):.2g} % of the residual rms "
            f"({self.regularisation}, strength {self.strength:g})"
        )

    def __repr__(self) -> str:
        return f"<ConsistentFit of {len(self.bodies)} bodies: {self._summary()}>"

    def __str__(self) -> str:
        lines = [self._summary()]
        for row in self.rows:
            centre = ", ".join(f"{row[axis]:.4g}" for axis in "xyz")
            lines.append(
                f"{row['body']}: {row['mass']:.4g} kg at ({centre}) m, margin {row['margin']:.2g}"
            )
        if self.boundary:
            lines.append(f"on the boundary: {', '.join(self.boundary)}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head = ("body", "mass (kg)", "x (m)", "y (m)", "z (m)", "margin")
        rows = ([body, *(f"{x:.4g}" for x in rest)] for body, *rest in map(dict.values, self.rows))
        return f"<p>{escape(self._summary())}</p>{html_table(head, rows)}"
