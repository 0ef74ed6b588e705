"""Tables I to III: geometry, base parameters, and what inertia transfer says of two of them."""

from __future__ import annotations

from math import cos, radians, sin

from rich.table import Table

from loopid.base_parameters import expression
from loopid.paper.base import BaseComparison
from loopid.paper.printed import SECONDS, TABLE_I, TABLE_II
from loopid.report.style import plain_table


def geometry_table(geometry: dict[str, float]) -> Table:
    """Table I, measured on the model."""
    table = plain_table("Table I: geometry (m, degrees)", "", ">paper", ">model")
    for name, printed in TABLE_I.items():
        table.add_row(name, f"{printed:g}", f"{geometry[name]:.6g}")
    return table


def base_table(comparison: BaseComparison) -> Table:
    """Table II, row by row."""
    base = comparison.base
    values = base.values(comparison.mechanism.standard_parameters("gravity"))
    columns = (">", "paper", "loopid", ">CAD", "unit")
    table = plain_table("Table II: base parameters of the 3UPS+RPU", *columns)
    for number, (printed, row) in enumerate(zip(TABLE_II, comparison.rows, strict=True), start=1):
        paper = paper_expression(printed)
        if row is None:
            table.add_row(str(number), paper, "not found", "", "")
            continue
        unit = base.parameters.select(base.base)[row].unit
        table.add_row(str(number), paper, base.expressions[row], f"{values[row]:.4f}", unit)
    return table


def paper_expression(terms: dict[str, float]) -> str:
    """A row of Table II in the paper's symbols."""
    return expression({_symbol(label): value for label, value in terms.items()})


def _symbol(label: str) -> str:
    """The paper's name of a parameter: leg1_stem.mx is m12 x12."""
    link, _, kind = label.rpartition(".")
    limb, _, part = link.removeprefix("leg").partition("_")
    index = {"cylinder": f"{limb}1", "stem": f"{limb}2"}.get(part, "m")
    return f"m{index}" if kind == "m" else f"m{index} {kind[1]}{index}"


def transfer_table(comparison: BaseComparison) -> Table:
    """Table III with its missing term: coefficients by formula, and as found by SVD."""
    columns = ("row", "term", "inertia transfer", ">by formula", ">found")
    table = plain_table("Table III: base parameters 9 and 10 by inertia transfer", *columns)
    for number, formulas in _transfer(TABLE_I).items():
        terms = comparison.base.terms[comparison.order[number - 1]]
        for label, (formula, value) in formulas.items():
            found = f"{terms.get(label, 0.0):.6f}"
            table.add_row(str(number), _symbol(label), formula, f"{value:.6f}", found)
    return table


def _transfer(geometry: dict[str, float]) -> dict[int, dict[str, tuple[str, float]]]:
    right, left = radians(geometry["beta_MD"]), radians(geometry["beta_MI"])
    two, three = geometry["Rm2"], geometry["Rm3"]
    return {
        9: {
            "leg1_stem.m": ("-Rm1", -geometry["Rm1"]),
            "leg2_stem.m": ("Rm2 cos beta_MD", two * cos(right)),
            "leg3_stem.m": ("Rm3 cos beta_MI (not in the paper)", three * cos(left)),
        },
        10: {
            "leg2_stem.m": ("Rm2 sin beta_MD", two * sin(right)),
            "leg3_stem.m": ("-Rm3 sin beta_MI", -three * sin(left)),
        },
    }


def search_table(comparison: BaseComparison) -> Table:
    """The search beside the paper's."""
    search, structure = comparison.base.search, comparison.base.structure
    table = plain_table("the search", "", "paper", "loopid")
    effect = f"{len(structure.columns)} of {len(comparison.base.parameters)}"
    table.add_row("parameters with an effect", "30", effect)
    table.add_row("base parameters", "15", f"{structure.rank} (gap {structure.rank_gap:.0e})")
    table.add_row("combinations", "155.12 million", f"{search.candidates:,}")
    table.add_row("least cond(V22)", "not given", f"{search.condition_number:.6f}")
    proof = f"proven, one of {search.ties:,} equally good" if search.certified else "not proven"
    table.add_row("is it the least?", "all were tried", proof)
    shorter = [f"{seconds / comparison.seconds:,.0f}" for seconds in SECONDS.values()]
    table.add_row("time, subgroups", "7 s", f"{shorter[0]} times shorter")
    table.add_row("time, every combination", "30 min", f"{shorter[1]} times shorter")
    table.add_row("time to the proven choice", "", f"{1e3 * comparison.seconds:.1f} ms")
    return table
