"""One line of a table of results."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """All numbers about one parameter.

    Attributes
    ----------
    number : int
        From 1 on.
    name, unit : str
    value, standard_error : float
    relative_std : float
        In %; infinite for an estimate of zero.
    interval : tuple of float
        Of 95 %; infinite where the data tell none.
    """

    number: int
    name: str
    unit: str
    value: float
    standard_error: float
    relative_std: float
    interval: tuple[float, float]

    def __str__(self) -> str:
        low, high = self.interval
        return (
            f"{self.number:3} {self.name}: {self.value:.5g} ± {self.standard_error:.2g} {self.unit}"
            f" ({self.relative_std:.1f} %), 95 %: {low:.5g} to {high:.5g}"
        )
