"""The report of ``loopid excite``: record, tables, charts, and the motion itself."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from rich.table import Table

from loopid.arguments import FloatArray
from loopid.excitation.design import ExcitationDesign
from loopid.files import csv_text
from loopid.motion.trajectories import FourierCurve, SplineCurve, Waypoint
from loopid.report.chart import Chart, Mark, Panel
from loopid.report.look import json_fields, json_value, number, plain_table
from loopid.report.page import Report, Section
from loopid.report.structure import force_unit
from loopid.yaml_files import yaml_writer

NAME = "excitation"  # of the motion in its file
MOST_BARS = 40  # parameters whose standard errors are drawn


def excitation_report(found: ExcitationDesign) -> Report:
    """A designed motion: what it tells, and what it keeps."""
    model, before = found.force_model, found.before.standard_errors
    known = np.isfinite(before)
    broken = [check.name for check in found.checks if check.violations]
    kept = f"breaks {', '.join(broken)}" if broken else "breaks no limit"
    change = ""
    if known.any():
        share = np.median((found.standard_errors / before)[known])
        earlier = "with the logs alone" if found.after_logs else "by the first motion tried"
        change = f", with standard errors {share:.2g} times those {earlier} (median)"
    verdict = (
        f"A motion of {found.motion.duration:g} s {kept} and tells "
        f"{np.isfinite(found.standard_errors).sum()} of {len(found.parameters)} parameters"
        f"{change}; the condition number is {found.criteria.condition_number:.3g}"
        + ("." if found.converged else ", which more evaluations may improve.")
    )
    return Report(
        name="excitation",
        title=f"{model.mechanism.name}, {model.model} model, excitation",
        verdict=verdict,
        record=excitation_record(found),
        brief=[_errors(found)],
        sections=lambda: [
            Section("Motion", (motion_chart(found), _summary(found))),
            Section("What it tells", (errors_chart(found), _errors(found), _noise(found))),
            Section("What it keeps", (_checks(found),)),
        ],
        results=lambda: {"motion.csv": motion_table(found), "motion.yaml": motion_file(found)},
    )


def excitation_record(found: ExcitationDesign) -> dict[str, Any]:
    """All findings of a design, ready for JSON."""
    criteria = "condition_number", "log_det", "trace", "least_eigenvalue"
    checked = "name", "unit", "lowest", "highest", "lower", "upper", "time", "violations"
    mechanism = found.force_model.mechanism
    return {
        "mechanism": mechanism.name,
        "model": found.force_model.model,
        "criterion": found.options.criterion,
        **json_fields(found.criteria, *criteria),
        **json_fields(found, "violations", "min_singularity_measure"),
        "duration": found.motion.duration,
        **json_fields(found, "seconds", "solver", "evaluations", "converged"),
        "coordinates": list(found.motion.names),
        "noise": dict(zip(mechanism.actuated, json_value(found.noise), strict=True)),
        "parameters": list(found.parameters.labels),
        **json_fields(found, "standard_errors"),
        "errors_before": json_value(found.before.standard_errors.tolist()),
        "checks": [json_fields(check, *checked) for check in found.checks],
    }


def _summary(found: ExcitationDesign) -> Table:
    criteria, force_model = found.criteria, found.force_model
    title = f"{force_model.mechanism.name}: a motion of {found.motion.duration:g} s"
    rows = (
        ("criterion that was optimised", found.options.criterion),
        ("condition number of the weighted observation", f"{criteria.condition_number:.4g}"),
        ("log det of the information (D)", f"{criteria.log_det:.4g}"),
        ("trace of its inverse (A)", f"{criteria.trace:.4g}"),
        ("its least eigenvalue (E)", f"{criteria.least_eigenvalue:.4g}"),
        ("violations on the fine grid", found.violations),
        ("least singularity measure", f"{found.min_singularity_measure:.4g}"),
        ("solver", f"{found.solver}, {found.evaluations} evaluations, {found.seconds:.1f} s"),
        ("converged", "yes" if found.converged else "no: more evaluations may do better"),
    )
    return plain_table(f"{title} for the {force_model.model} model", ("", ""), rows)


def _errors(found: ExcitationDesign) -> Table:
    before = "logs" if found.after_logs else "first motion"
    columns = ("leading parameter", ">± std", f">by the {before}", "unit")
    before_errors = found.before.standard_errors
    errors = zip(found.parameters, found.standard_errors, before_errors, strict=True)
    rows = ((p.label, f"{after:.3g}", f"{earlier:.3g}", p.unit) for p, after, earlier in errors)
    return plain_table("predicted standard errors", columns, rows)


def _noise(found: ExcitationDesign) -> Table:
    mechanism, sizes = found.force_model.mechanism, np.sqrt((found.forces**2).mean(axis=0))
    slides = np.isin(mechanism.velocity_indices(mechanism.actuated), mechanism.prismatic)
    rows = [
        (name, f"{noise:.3g}", "N" if slide else "N m", f"{noise / size:.2%}" if size else "")
        for name, noise, slide, size in zip(
            mechanism.actuated, found.noise, slides, sizes, strict=True
        )
    ]
    title = f"noise that they assume, independent at {found.options.rate:g} Hz"
    return plain_table(title, ("force of", ">± std", "unit", ">of its root mean square"), rows)


def _checks(found: ExcitationDesign) -> Table:
    rows = (
        (
            check.name,
            *map(number, (check.lowest, check.highest, check.lower, check.upper)),
            check.unit,
            check.violations,
        )
        for check in found.checks
    )
    title = "check list, on a grid ten times finer than the design's"
    columns = ("", ">least", ">most", ">from", ">to", "unit", ">broken")
    return plain_table(title, columns, rows)


def motion_table(found: ExcitationDesign) -> str:
    """Position, velocity and acceleration of every motor over time, as CSV."""
    motors = found.motors
    names = [
        f"{motor}.{what}"
        for what in ("position", "velocity", "acceleration")
        for motor in motors.names
    ]
    columns = motors.time, motors.position, motors.velocity, motors.acceleration
    return csv_text(["time", *names], *columns, digits=12)


def motion_file(found: ExcitationDesign) -> str:
    """The motion file that ``read_motion_program`` reads."""
    names, here, steps = found.motion.names, found.start, list[dict[str, Any]]()
    for waypoint in found.waypoints:
        steps.append(_step(names, here, waypoint))
        here = waypoint.position
    duration, goal = len(found.motion) - 1, found.options.criterion
    content = {
        "coordinates": list(names),
        "rate": float(duration / found.motion.duration),
        "motions": {
            NAME: {
                "description": f"excites the {found.force_model.model} model, {goal}",
                "start": _pose(names, found.start),
                "steps": steps,
            }
        },
    }
    text = io.StringIO()
    yaml_writer().dump(content, text)
    return text.getvalue()


def _pose(names: tuple[str, ...], values: FloatArray) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def _step(names: tuple[str, ...], here: FloatArray, waypoint: Waypoint) -> dict[str, Any]:
    curve, seconds = waypoint.curve, float(waypoint.seconds)
    if isinstance(curve, FourierCurve):
        sine, cosine = np.split(curve.shape, 2)
        terms = {
            name: {"sine": sine[:, k].tolist(), "cosine": cosine[:, k].tolist()}
            for k, name in enumerate(names)
        }
        return {"fourier": terms, "seconds": seconds}
    if isinstance(curve, SplineCurve):
        return {"spline": [_pose(names, here + x) for x in curve.shape], "seconds": seconds}
    if (waypoint.position == here).all():
        return {"hold": seconds}
    return {"to": _pose(names, waypoint.position), "seconds": seconds}


def motion_chart(found: ExcitationDesign) -> Chart:
    """Position of each motor with its limits, and its force below."""
    motors, mechanism, panels = found.motors, found.force_model.mechanism, list[Panel]()
    limits = {check.name: (check.lower, check.upper) for check in found.checks}
    span = motors.time[[0, -1]]
    for k, name in enumerate(motors.names):
        unit = "m" if force_unit(mechanism, name) == "N" else "rad"
        marks = [Mark("position", motors.time, motors.position[:, k], "fit")]
        for end in limits.get(f"position of {name}", ()):
            if np.isfinite(end):
                marks.append(Mark("limit", span, np.full(2, end), "limit"))
        force = Mark("force by the robot file", motors.time, found.forces[:, k], "file")
        panels += [
            Panel(f"{name} ({unit})", tuple(marks)),
            Panel(f"force ({force_unit(mechanism, name)})", (force,), small=True),
        ]
    caption = "Motors: position with its limits, and force by the robot file. Drag to zoom in."
    return Chart("motion", caption, "time (s)", tuple(panels), zoom=True)


def errors_chart(found: ExcitationDesign) -> Chart:
    """Standard errors of the least known parameters, before and after."""
    count = min(len(found.parameters), MOST_BARS)
    worst = np.sort(np.argsort(-found.standard_errors, kind="stable")[:count])
    place = np.arange(count, dtype=np.float64)
    before, after = found.before.standard_errors[worst], found.standard_errors[worst]
    label = "with the logs" if found.after_logs else "first motion"
    marks = (
        Mark(label, before, place, "faint", "dots"),
        Mark("with this motion", after, place, "fit", "dots"),
    )
    labels = tuple(found.parameters.labels[j] for j in worst)
    panel = Panel("standard error (kg, kg m, kg m², ...)", marks, labels=labels, log="x")
    caption = "Predicted standard errors; one dot alone: unidentifiable without the motion."
    return Chart("errors", caption, "", (panel,))
