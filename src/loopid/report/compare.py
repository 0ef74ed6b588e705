"""The report of ``loopid compare``: saved fits beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from loopid.errors import OptionError
from loopid.identification.saved import SavedFit
from loopid.plots.pictures import comparison_chart
from loopid.report.look import json_value, plain_table, table_of, with_error
from loopid.report.page import Report, Section

CLEAR = 3.0  # standard errors of a difference, from which values differ clearly
BESIDE = 3  # fits that a table has room for
RUN = {
    **{"run": "name", "robot": "robot", "model": "model", "estimator": "estimator"},
    ">RMS errors of the motors' forces": lambda run: (
        ", ".join(f"{x:.3g}" for x in run["rms"] or ()) or "-"
    ),
}


def comparison_report(fits: dict[str, SavedFit]) -> Report:
    """Values of fits by the name of their run, matched by what they are sums of.

    Raises
    ------
    OptionError
        When there are fewer than two.
    """
    if len(fits) < 2:
        raise OptionError(f"two fits or more can be compared, not {len(fits)}", given=len(fits))
    record = comparison_record(fits)
    rows, names = record["parameters"], list(fits)
    common = [row for row in rows if None not in row["values"]]
    apart = sorted((row for row in common if row["apart"]), key=lambda row: -row["apart"])
    clear = [row["name"] for row in apart if row["apart"] > CLEAR]
    first = f", {clear[0]} by {apart[0]['apart']:.2g} standard errors" if clear else ""
    lone = len(rows) - len(common)
    others = f"; {lone} are not in all of them" if lone else ""
    tables = [_table(rows, names, k) for k in range(0, len(names), BESIDE)]
    return Report(
        name="comparison",
        title=f"{', '.join(names)} compared",
        verdict=(
            f"{len(clear)} of {len(common)} parameters that {len(fits)} fits have in common differ "
            f"clearly{first}{others}."
        ),
        record=record,
        brief=tables,
        sections=lambda: [
            Section("Fits", (table_of("", RUN, record["runs"]),)),
            Section("Parameters", (comparison_chart(fits), *tables)),
        ],
    )


def comparison_record(fits: dict[str, SavedFit]) -> dict[str, Any]:
    """Values and standard errors of each parameter, null where a fit has none; ready for JSON."""
    known = dict[str, dict[str, Any]]()
    for k, fit in enumerate(fits.values()):
        for each in fit.base_parameters:
            row = known.setdefault(
                each.expression,
                {"name": each.name, "expression": each.expression, "unit": each.unit}
                | {key: [None] * len(fits) for key in ("values", "standard_errors")},
            )
            row["values"][k], row["standard_errors"][k] = each.value, each.standard_error
    for row in known.values():
        row["apart"] = _apart(row["values"], row["standard_errors"])
        row["standard_errors"] = json_value(row["standard_errors"])
    runs = [
        {
            "name": name,
            "robot": fit.robot.name,
            "model": fit.force_model.model,
            "estimator": fit.estimate and fit.estimate.estimator,
            "rms": None if fit.estimate is None else json_value(fit.estimate.quality.residual_rms),
        }
        for name, fit in fits.items()
    ]
    return {"runs": runs, "parameters": list(known.values())}


def _apart(values: Sequence[float | None], errors: Sequence[float | None]) -> float | None:
    """The largest difference of two values, in its standard errors."""
    x, s = (np.array(each, dtype=np.float64) for each in (values, errors))
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.abs(x[:, None] - x) / np.hypot(s[:, None], s)
    found = apart[np.isfinite(apart)]
    return float(found.max()) if found.size else None


def _table(rows: Sequence[dict[str, Any]], names: Sequence[str], first: int) -> Table:
    shown = range(first, min(first + BESIDE, len(names)))
    columns = [part for k in shown for part in (f">{names[k]}", ">±")]
    cells = (
        (
            row["name"],
            *(text for k in shown for text in _cells(row["values"][k], row["standard_errors"][k])),
            row["unit"],
            "*" if (row["apart"] or 0.0) > CLEAR else "",
        )
        for row in rows
    )
    title = f"parameters; * values differ by more than {CLEAR:g} standard errors"
    return plain_table(title, ("", *columns, "unit", ""), cells)


def _cells(value: float | None, error: float | None) -> tuple[str, str]:
    return ("-", "-") if value is None else with_error(value, error or 0.0)
