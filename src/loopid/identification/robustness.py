"""What a robust estimator made of the samples."""

from __future__ import annotations

from dataclasses import dataclass

from loopid.arrays import FloatArray, frozen
from loopid.identification.comparison import ComparedByFields


@dataclass(frozen=True, eq=False)
class Robustness(ComparedByFields):
    """Scale and weights of the residuals, an actuator each; NaN where it has no samples.

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
