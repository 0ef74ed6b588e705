"""Tables I to III: the robot's geometry and base parameters beside the printed ones."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters import BaseParameters, find_base_parameters
from loopid.errors import SearchError
from loopid.paper.printed import PRINTED_DIGITS, TABLE_II
from loopid.regressors import structural_observation
from loopid.robot import Mechanism

TIMED_RUNS = 7
# Table I measures the angles of points 2 (D) and 3 (I) from opposite sides of the x axis.
SIDES = {2: ("D", 1.0), 3: ("I", -1.0)}


def measured_geometry(mechanism: Mechanism) -> dict[str, float]:
    """Radii in m and angles in degrees of the joints' centres in the model, named as in Table I."""
    model, found = mechanism.model, {}
    for limb in (1, 2, 3):
        base = model.jointPlacements[model.getJointId(f"leg{limb}_universal_1")]
        platform = model.frames[model.getFrameId(f"platform_B{limb}")].placement
        for radius, angle, place in (("R", "beta_F", base), ("Rm", "beta_M", platform)):
            x, y, _ = place.translation
            found[f"{radius}{limb}"] = float(np.hypot(x, y))
            if limb in SIDES:
                name, sign = SIDES[limb]
                found[angle + name] = sign * float(np.degrees(np.arctan2(y, x)))
    revolute = model.jointPlacements[model.getJointId("leg4_revolute")].translation
    return found | {"d_s": float(revolute[0])}


@dataclass(frozen=True)
class BaseComparison:
    """Base parameters of the 3UPS+RPU beside Table II.

    Attributes
    ----------
    mechanism : Mechanism
    base : BaseParameters
    rows : tuple of int or None
        For each row of Table II the base parameter that equals it to the printed digits.
    seconds : float
        Median time from the triangular factor to the certified choice.
    """

    mechanism: Mechanism
    base: BaseParameters
    rows: tuple[int | None, ...]
    seconds: float

    @property
    def agrees(self) -> bool:
        """Whether every row of Table II was found."""
        return None not in self.rows

    @property
    def order(self) -> IntArray:
        """(15,), columns of the base parameters in the order of Table II."""
        return rows_of_table_ii(self.base)

    @property
    def values(self) -> FloatArray:
        """(15,), values of the base parameters from the robot file."""
        return self.base.values(self.mechanism.standard_parameters("gravity"))


def compare_base_parameters(mechanism: Mechanism) -> BaseComparison:
    """Find the base parameters of the 3UPS+RPU and match them with Table II."""
    observation, times = structural_observation(mechanism), []
    for _ in range(TIMED_RUNS):
        start = perf_counter()
        base = find_base_parameters(observation)
        times.append(perf_counter() - start)
    return BaseComparison(mechanism, base, matching_rows(base), float(np.median(times)))


def matching_rows(base: BaseParameters) -> tuple[int | None, ...]:
    """For each row of Table II the base parameter that equals it to the printed digits."""

    def equal(terms: dict[str, float], printed: dict[str, float]) -> bool:
        return terms.keys() == printed.keys() and all(
            abs(terms[label] - printed[label]) <= PRINTED_DIGITS for label in terms
        )

    return tuple(
        next((j for j, terms in enumerate(base.terms) if equal(terms, printed)), None)
        for printed in TABLE_II
    )


def rows_of_table_ii(base: BaseParameters) -> IntArray:
    """Columns (15,) of base parameters in the order of Table II.

    Raises
    ------
    SearchError
        When a row is not among them.
    """
    rows = matching_rows(base)
    missing = [str(number) for number, row in enumerate(rows, start=1) if row is None]
    if missing:
        raise SearchError(f"rows {', '.join(missing)} of the paper's Table II were not found")
    return np.array(rows, dtype=np.int64)
