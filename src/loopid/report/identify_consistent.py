"""Physically consistent bodies, as an identification found them: table and sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from loopid.report.tables import plain_table

if TYPE_CHECKING:
    from loopid.consistency import ConsistentFit


def consistent_table(found: ConsistentFit) -> Table:
    """A row a body."""
    columns = "body", ">mass (kg)", ">centre of mass (m)", ">margin"
    table = plain_table(f"physically consistent bodies ({found.regularisation})", *columns)
    for row in found.rows:
        centre = ", ".join(f"{row[axis]:.4g}" for axis in "xyz")
        table.add_row(row["body"], f"{row['mass']:.4g}", centre, f"{row['margin']:.2g}")
    return table


def consistent_sentences(found: ConsistentFit) -> list[str]:
    """Whether consistent bodies have the fitted parameters, and what consistency costs."""
    have = "have" if found.feasible else "cannot have"
    cost = 100 * (found.fit_cost.total - 1)
    said = [
        f"Physically consistent bodies {have} exactly the base parameters of the fit; those fitted "
        f"to the data, near the robot file, raise the weighted residual by {cost:.2g} %."
    ]
    if found.boundary:
        said.append(
            f"The data pull {', '.join(found.boundary)} to the boundary of what is consistent."
        )
    if found.repaired:
        said.append(
            f"The robot file is not physically consistent in {', '.join(found.repaired)}: repaired."
        )
    return said
