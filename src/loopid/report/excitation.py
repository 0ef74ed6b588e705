"""The report of ``loopid excite``: record, tables, charts, and the motion itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from loopid.arguments import checked
from loopid.excitation.design import ExcitationDesign
from loopid.files import csv_text
from loopid.motion.files import motion_text
from loopid.numbers import number
from loopid.plots.excitation import errors_chart, motion_chart
from loopid.plots.structure import robot_chart
from loopid.report.look import json_fields, plain_table, table_of
from loopid.report.page import Card, Figure, Report, Section, panel_table

NAME = "excitation"  # of the motion in its file
CRITERIA = "condition_number", "log_det", "trace", "least_eigenvalue"
FOUND = (
    *("violations", "min_singularity_measure", "seconds", "solver", "evaluations", "converged"),
    *("standard_errors", "pairs"),
)


@checked
def excitation_report(found: ExcitationDesign) -> Report:
    """A designed motion: its information, and its limits.

    Parameters
    ----------
    found : ExcitationDesign

    Returns
    -------
    Report

    Examples
    --------
    >>> import loopid
    >>> model = loopid.force_model(loopid.load("parallelogram"), joint_terms=None)
    >>> options = loopid.DesignOptions(duration=4.0, starts=1, evaluations=2, solver="slsqp")
    >>> found = loopid.design_motion(model, options=options)
    >>> loopid.report.excitation_report(found).title
    'parallelogram, gravity model, excitation'
    """
    model, before, after = found.force_model, found.errors_before, found.standard_errors
    known, excited, count = np.isfinite(before), int(np.isfinite(after).sum()), len(after)
    broken = ", ".join(check.name for check in found.checks if check.violations)
    seconds, condition = f"{found.motion.duration:g} s", f"{found.criteria.condition_number:.3g}"
    change = ""
    if known.any():
        share = np.median((after / before)[known])
        earlier = "with the logs alone" if found.after_logs else "by the first motion tried"
        change = f", with standard errors {share:.2g} times those {earlier} (median)"
    verdict = (
        f"A motion of {seconds} breaks {broken or 'no limit'} and determines {excited} of {count} "
        f"parameters{change}; the condition number is {condition}"
        + ("." if found.converged else ", which more evaluations may improve.")
    )
    search = (
        f"Criterion {found.options.criterion} by {found.solver}: {found.evaluations} evaluations "
        f"in {found.seconds:.1f} s."
    )
    columns = {
        **{"": "name", ">least": "lowest", ">most": "highest", ">from": "lower", ">to": "upper"},
        **{"unit": "unit", ">broken": "violations"},
    }
    kept = table_of("limits, on a ten times finer grid", columns, found.checks)
    chart, steps = errors_chart(found), "run motion.csv on the robot, and identify from its log."
    return Report(
        name="excitation",
        title=f"{model.robot.name}, {model.model} model, excitation",
        verdict=verdict,
        record=lambda: excitation_record(found),
        brief=[panel_table(chart.panels[0])],
        card=Card(
            tone="bad" if broken else "good" if excited == count else "rough",
            word="Breaks limits" if broken else "Keeps all limits",
            use=broken or f"in a motion of {seconds}",
            figures=(
                Figure(str(excited), "parameters determined", f"of {count}"),
                Figure(condition, "condition number"),
                Figure(f"{found.min_singularity_measure:.3g}", "least singularity measure"),
                Figure(str(found.violations), "violations on the fine grid"),
            ),
            next="give the motion more room: a limit is broken." if broken else steps,
        ),
        pictures=lambda: (robot_chart(model.robot),),
        sections=lambda: [
            Section("Motion", (motion_chart(found),)),
            Section("Expected accuracy", (chart, _noise(found))),
            Section("What it keeps", (kept, search)),
        ],
        results=lambda _: _motion_files(found),
    )


def _motion_files(found: ExcitationDesign) -> dict[str, bytes | str]:
    """Position, velocity and acceleration of every motor over time, and the steps."""
    table = found.motors._table()
    said = f"excites the {found.force_model.model} model, {found.options.criterion}"
    steps = motion_text(NAME, said, found.motion, found.start, found.waypoints)
    return {"motion.csv": csv_text([*table], *table.values(), digits=12), "motion.yaml": steps}


def excitation_record(found: ExcitationDesign) -> dict[str, Any]:
    """All findings of a design, ready for JSON."""
    robot = found.force_model.robot
    return {
        "mechanism": robot.name,
        "model": found.force_model.model,
        "criterion": found.options.criterion,
        **json_fields(found.criteria, *CRITERIA),
        **json_fields(found, *FOUND),
        "duration": found.motion.duration,
        "coordinates": list(found.motion.names),
        "noise": dict(zip(robot.actuated, found.noise.tolist(), strict=True)),
        "parameters": list(found.parameters.names),
        **json_fields(found, "errors_before", "checks"),
    }


def _noise(found: ExcitationDesign) -> Table:
    robot, sizes = found.force_model.robot, np.sqrt((found.forces**2).mean(axis=0))
    parts = 100 * found.noise / np.where(sizes > 0, sizes, np.nan)
    rows = (
        (name, f"{noise:.3g} {robot.units(name)[1]}", f"{number(part, 3)} %")
        for name, noise, part in zip(robot.actuated, found.noise, parts, strict=True)
    )
    title = f"assumed noise, independent at {found.options.rate:g} Hz"
    return plain_table(title, ("force of", ">± std", ">of its root mean square"), rows)
