"""Tables I to III: geometry, base parameters by all searches, and the symbolic model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from loopid.arguments import FloatArray, IntArray
from loopid.base_parameters.base import BaseParameters, base_of_choice, find_base
from loopid.base_parameters.choice import ChoiceProblem, SearchResult
from loopid.base_parameters.subgroups import VARIANTS, SubgroupSearch
from loopid.errors import OptionError
from loopid.kinematics.measured import platform_coordinates
from loopid.kinematics.sampling import random_configurations
from loopid.records import record
from loopid.regressors.motion_regressors import gravity_regressor
from loopid.regressors.structural import structural_observation
from loopid.robot.robot import Robot

if TYPE_CHECKING:
    from loopid.paper.symbolic import Geometry

# What the paper prints.

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

TABLE_III = 9, 10  # rows of Table II that it derives

# The paper's searches: what was tried, least cond(V22), whether proven, time on its machine.
TIMES = {
    "subgroups": ("12 groups of 3,876 combinations", "not given", "no", "7 s"),
    "all combinations": ("155.12 million combinations", "not given", "yes, all tried", "30 min"),
}
# The same of ``python benchmarks/search.py --full``.
EXHAUSTIVE = "155,117,520 combinations", "2.2370", "yes, one of 4,096", "minutes"

POSES = 200  # at which symbolic and numeric regressors are compared
FIELDS = {"d_s": "ds"}  # of the symbolic geometry, where Table I has another name
# Table I measures the angles of points 2 (D) and 3 (I) from opposite sides of the x axis.
SIDES = {2: ("D", 1.0), 3: ("I", -1.0)}


def measured_geometry(robot: Robot) -> dict[str, float]:
    """Radii in m and angles in degrees of the joints' centres in the model, named as in Table I."""
    model, found = robot.model, {}
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


@record
class BaseComparison:
    """Base parameters of the 3UPS+RPU beside Table II."""

    robot: Robot
    base: BaseParameters  # by exact search
    rows: tuple[int | None, ...]  # for each row of Table II the base parameter that equals it
    subgroups: dict[str, SearchResult]  # the paper's search, by variant
    subgroup_rows: dict[str, int]  # rows of Table II that its choice gives, whatever their sign

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
        return self.base.values(self.robot.standard_parameters("gravity"))


def compare_base_parameters(robot: Robot) -> BaseComparison:
    """Search in all ways, limb by limb as Φ_G has the columns, and match with Table II."""
    base = find_base(structural_observation(robot))
    problem = ChoiceProblem(base.structure)
    subgroups = {name: SubgroupSearch(variant=name).search(problem) for name in VARIANTS}
    counts = dict.fromkeys(VARIANTS, 0)
    for name, search in subgroups.items():
        if search.found:
            rows = matching_rows(base_of_choice(base.parameters, base.structure, search), (1, -1))
            counts[name] = len(rows) - rows.count(None)
    return BaseComparison(robot, base, matching_rows(base), subgroups, counts)


def matching_rows(base: BaseParameters, signs: Sequence[int] = (1,)) -> tuple[int | None, ...]:
    """For each row of Table II the base parameter that equals it to the printed digits."""

    def equal(terms: Mapping[str, float], printed: dict[str, float]) -> bool:
        return terms.keys() == printed.keys() and any(
            all(abs(sign * terms[label] - printed[label]) <= PRINTED_DIGITS for label in terms)
            for sign in signs
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
        raise OptionError(f"rows {', '.join(missing)} of the paper's Table II were not found")
    return np.array(rows, dtype=np.int64)


# The symbolic model.


@record
class Transfer:
    """A term of Table III: what inertia transfer makes of a parameter in a base parameter."""

    row: int  # of Table II
    label: str  # of the parameter
    formula: str
    value: float  # m


@record
class SymbolicComparison:
    """K_G derived by SymPy from the paper's geometry, beside Pinocchio's K of the robot file."""

    poses: int  # random closed ones
    columns: int  # that both have
    difference: float  # largest of an entry, relative to the largest entry at its pose
    transfers: tuple[Transfer, ...]  # Table III


def compare_symbolic(robot: Robot, seed: int = 0) -> SymbolicComparison:
    """Compare both gravity regressors at random closed poses; this takes SymPy."""
    from loopid.paper import symbolic

    printed = {FIELDS.get(name, name): value for name, value in TABLE_I.items()}
    geometry = symbolic.Geometry.from_degrees(**printed)
    q = random_configurations(robot, POSES, seed=seed)
    pose = platform_coordinates(robot, q)
    expected, found = symbolic.gravity_regressor(geometry, pose), gravity_regressor(robot, q)
    names = robot.parameters("gravity").labels
    found = found[:, :, [names.index(label) for label in symbolic.GRAVITY_LABELS]]
    difference = np.abs(found - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))
    return SymbolicComparison(
        poses=POSES,
        columns=found.shape[2],
        difference=float(difference.max()),
        transfers=inertia_transfers(geometry),
    )


def inertia_transfers(geometry: Geometry) -> tuple[Transfer, ...]:
    """Table III: masses that are transferred to the platform's first moments, by formula."""
    from loopid.paper import symbolic

    symbols, found = symbolic.parameter_symbols(), list[Transfer]()
    for row in symbolic.base_parameter_rows():
        values = row.coefficients(geometry)
        if row.number in TABLE_III:
            for label in (label for label in values if not label.startswith("platform")):
                formula = str(row.expression.coeff(symbols[label])).replace("*", " ")
                found.append(Transfer(row.number, label, formula, values[label]))
    return tuple(found)
