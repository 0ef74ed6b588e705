"""The knee-rehabilitation paper's Table II beside what loopid finds.

Gravitational Base Parameters Identification for a Knee Rehabilitation Parallel Robot: the printed
rows are data here, checked against the closed forms in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from rich.table import Table

from loopid.base_parameters import BaseParameters, find_base_parameters
from loopid.base_parameters.expressions import expression
from loopid.loading import load_mechanism
from loopid.mechanism import Mechanism
from loopid.regressors import structural_observation
from loopid.report.style import plain_table

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
PRINTED_DIGITS = 5e-5  # half of the last printed decimal
PAPER_SECONDS = {"subgroup": 7.0, "exhaustive": 30 * 60.0}  # on the authors' own desktop
TIMED_RUNS = 7


@dataclass(frozen=True)
class PaperComparison:
    """Base parameters of the paper's robot beside the paper's.

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


def compare_with_paper() -> PaperComparison:
    """Find the base parameters of the 3UPS+RPU and match them with Table II."""
    mechanism = load_mechanism("3ups_rpu")
    observation = structural_observation(mechanism)
    base = find_base_parameters(observation)
    times = []
    for _ in range(TIMED_RUNS):
        start = perf_counter()
        find_base_parameters(observation)
        times.append(perf_counter() - start)
    rows = tuple(_matching(base, row) for row in TABLE_II)
    return PaperComparison(mechanism, base, rows, float(np.median(times)))


def _matching(base: BaseParameters, printed: dict[str, float]) -> int | None:
    for number, terms in enumerate(base.terms):
        if terms.keys() == printed.keys() and all(
            abs(terms[label] - printed[label]) <= PRINTED_DIGITS for label in terms
        ):
            return number
    return None


def paper_tables(comparison: PaperComparison) -> list[Table]:
    """Table II row by row, and the search beside the paper's."""
    return [_table_ii(comparison), _search_table(comparison)]


def _table_ii(comparison: PaperComparison) -> Table:
    base = comparison.base
    values = base.values(comparison.mechanism.standard_parameters("gravity"))
    columns = (">", "paper", "loopid", ">CAD", "unit")
    table = plain_table("Table II: base parameters of the 3UPS+RPU", *columns)
    for number, (printed, row) in enumerate(zip(TABLE_II, comparison.rows, strict=True), start=1):
        paper = expression({_paper_symbol(label): value for label, value in printed.items()})
        if row is None:
            table.add_row(str(number), paper, "[red]not found[/red]", "", "")
            continue
        unit = base.parameters.select(base.base)[row].unit
        table.add_row(str(number), paper, base.expressions[row], f"{values[row]:.4f}", unit)
    return table


def _paper_symbol(label: str) -> str:
    """The paper's name of a parameter: leg1_stem.mx is m12 x12."""
    link, _, kind = label.rpartition(".")
    limb, _, part = link.removeprefix("leg").partition("_")
    index = {"cylinder": f"{limb}1", "stem": f"{limb}2"}.get(part, "m")
    return f"m{index}" if kind == "m" else f"m{index} {kind[1]}{index}"


def _search_table(comparison: PaperComparison) -> Table:
    search, structure = comparison.base.search, comparison.base.structure
    table = plain_table("the search", "", "paper", "loopid")
    effect = f"{len(structure.columns)} of {len(comparison.base.parameters)}"
    table.add_row("parameters with an effect", "30", effect)
    table.add_row("base parameters", "15", f"{structure.rank} (gap {structure.rank_gap:.0e})")
    table.add_row("combinations", "155.12 million", f"{search.candidates:,}")
    table.add_row("least cond(V22)", "not given", f"{search.condition_number:.6f}")
    proof = f"proven, one of {search.ties:,} equally good" if search.certified else "not proven"
    table.add_row("is it the least?", "all were tried", proof)
    shorter = [f"{seconds / comparison.seconds:,.0f}" for seconds in PAPER_SECONDS.values()]
    table.add_row("time, subgroups", "7 s", f"{shorter[0]} times shorter")
    table.add_row("time, every combination", "30 min", f"{shorter[1]} times shorter")
    table.add_row("time to the proven choice", "", f"{1e3 * comparison.seconds:.1f} ms")
    return table
