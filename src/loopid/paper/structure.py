"""What the paper prints; Tables I to III, geometry and base parameters, beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.base_parameters import BaseParameters, find_base_parameters
from loopid.errors import SearchError
from loopid.regressors import structural_observation
from loopid.robot import Mechanism

# Table I: m and degrees.
TABLE_I = {
    "R1": 0.4,
    "R2": 0.4,
    "R3": 0.4,
    "Rm1": 0.3,
    "Rm2": 0.3,
    "Rm3": 0.3,
    "beta_FD": 90.0,
    "beta_FI": 45.0,
    "d_s": 0.15,
    "beta_MD": 50.0,
    "beta_MI": 90.0,
}

# Table II, row by row; the coefficients are printed with four decimals.
TABLE_II: tuple[dict[str, float], ...] = (
    {"leg1_stem.m": 1, "leg2_stem.m": 1, "leg3_stem.m": 1, "leg4_stem.m": 1, "platform.m": 1},
    {"leg1_cylinder.mx": 1, "leg1_stem.mx": 1},
    {"leg2_cylinder.mx": 1, "leg2_stem.mx": 1},
    {"leg1_cylinder.mz": 1, "leg1_stem.mz": 1},
    {"leg2_cylinder.mz": 1, "leg2_stem.mz": 1},
    {"leg3_cylinder.mz": 1, "leg3_stem.mz": 1},
    {"leg3_cylinder.mx": 1, "leg3_stem.mx": 1},
    {"leg4_stem.my": 1, "leg4_cylinder.mz": -1},
    {"leg2_stem.m": 0.1928, "leg1_stem.m": -0.3, "platform.mx": 1},
    {"leg2_stem.m": 0.2298, "leg3_stem.m": -0.3, "platform.my": 1},
    {"platform.mz": 1},
    {"leg4_stem.mx": 1, "leg4_cylinder.mx": -1},
    {"leg1_cylinder.my": 1, "leg1_stem.my": 1},
    {"leg2_cylinder.my": 1, "leg2_stem.my": 1},
    {"leg3_cylinder.my": 1, "leg3_stem.my": 1},
)
PRINTED_DIGITS = 5e-5  # half of the last printed decimal of a coefficient

# Tables IV and V: the first eight rows of Table II, in kg and kg m.
TABLE_IV = (14.12, -0.35, 0.17, 1.58, 1.41, 1.40, 0.15, -0.94)
TABLE_V = (15.60, 1.46, 0.82, 0.82, -0.89, -1.58, -0.37, -0.76)

FORCE_NOISE = 12.0  # N, half the width of the noise that the paper adds to its simulated forces
CONDITION_NUMBERS = {15: 646.6, 8: 73.5}  # of W_1, for a trajectory that is not named
TIMES = "7 s for subgroups, 30 min for all combinations"

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
    """Base parameters of the 3UPS+RPU beside Table II."""

    mechanism: Mechanism
    base: BaseParameters
    rows: tuple[int | None, ...]  # for each row of Table II the base parameter that equals it
    seconds: float  # median, from the triangular factor to the certified choice

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

    def equal(terms: Mapping[str, float], printed: dict[str, float]) -> bool:
        return terms.keys() == printed.keys() and all(
            abs(terms[label] - printed[label]) <= PRINTED_DIGITS for label in terms
        )

    found = base.terms
    return tuple(
        next((j for j, terms in enumerate(found) if equal(terms, printed)), None)
        for printed in TABLE_II
    )


def rows_of_table_ii(base: BaseParameters) -> IntArray:
    """Columns (15,) of base parameters in the order of Table II; all must be there."""
    rows = matching_rows(base)
    missing = [str(number) for number, row in enumerate(rows, start=1) if row is None]
    if missing:
        raise SearchError(f"rows {', '.join(missing)} of the paper's Table II were not found")
    return np.array(rows, dtype=np.int64)
