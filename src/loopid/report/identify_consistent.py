"""Bodies that can exist, as an identification found them: table and sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.table import Table

from loopid.report.tables import plain_table

if TYPE_CHECKING:
    from loopid.consistency import ConsistentFit


def consistent_record(found: ConsistentFit | None) -> dict[str, Any] | None:
    """All of it, ready for JSON."""
    return None if found is None else found.record()


def consistent_table(found: ConsistentFit) -> Table:
    """A row a body."""
    columns = "body", ">mass (kg)", ">centre of mass (m)", ">margin"
    table = plain_table(f"bodies that can exist ({found.regularisation})", *columns)
    for row in found.rows:
        centre = ", ".join(f"{row[axis]:.4g}" for axis in "xyz")
        table.add_row(row["body"], f"{row['mass']:.4g}", centre, f"{row['margin']:.2g}")
    return table


def consistent_sentences(found: ConsistentFit) -> list[str]:
    """Whether bodies have the fitted parameters, and what it costs that they do."""
    have = "There are bodies" if found.feasible else "No bodies that can exist are there"
    cost = 100 * (found.fit_cost.total - 1)
    said = [
        f"{have} with exactly the base parameters of the fit; the nearest to the robot file that "
        f"fit the data raise the weighted residual by {cost:.2g} %."
    ]
    if found.boundary:
        said.append(f"The data pull {', '.join(found.boundary)} to the edge of what can exist.")
    if found.repaired:
        said.append(f"In the robot file {', '.join(found.repaired)} cannot exist: mended.")
    return said
