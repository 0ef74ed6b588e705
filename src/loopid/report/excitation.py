"""The report of ``loopid excite``: record, tables, check list, figures, and the motion itself."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from rich.table import Table

from loopid.arguments import FloatArray
from loopid.excitation.design import ExcitationDesign
from loopid.files import csv_text
from loopid.motion.trajectories import FourierCurve, SplineCurve, Waypoint
from loopid.report.look import (
    BLUE,
    GREY,
    ORANGE,
    RED,
    drawing,
    drawn,
    json_fields,
    json_text,
    json_value,
    markdown_page,
    plain_log_labels,
    plain_table,
    rendered,
    thinned,
)
from loopid.yaml_files import yaml_writer

NAME = "excitation"  # of the motion in its file
MOST_BARS = 40  # parameters whose standard errors are drawn
CAPTIONS = {
    "motion": "Motors: position (line), its limits (dashed), and force by the robot file.",
    "errors": "Predicted standard errors, of the largest ones, before and after.",
}


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


def excitation_tables(found: ExcitationDesign) -> list[Table]:
    """What the motion tells, standard errors with the noise that they assume, check list."""
    return [_summary(found), _errors(found), _noise(found), _checks(found)]


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
    return plain_table(f"{title} for the {force_model.model} model", ("", ">"), rows)


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
    rows = []
    for check in found.checks:
        limits = f"{check.lower:.4g} ... {check.upper:.4g}"
        if not np.isfinite(check.upper):
            limits = f"from {check.lower:.4g}"
        elif not np.isfinite(check.lower):
            limits = f"up to {check.upper:.4g}"
        name = f"{check.name} ({check.unit})" if check.unit else check.name
        motion = f"{check.lowest:.4g} ... {check.highest:.4g}"
        rows.append((name, motion, limits, check.violations))
    title = "check list, on a grid ten times finer than the design's"
    return plain_table(title, ("", ">motion", ">limits", ">broken"), rows)


def excitation_files(found: ExcitationDesign) -> dict[str, bytes | str]:
    """Motion, report, record and figures, by file name."""
    title = f"Excitation of {found.force_model.mechanism.name}"
    return {
        "motion.csv": motion_table(found),
        "motion.yaml": motion_file(found),
        "report.md": markdown_page(title, excitation_tables(found), CAPTIONS),
        "excitation.json": json_text(excitation_record(found)) + "\n",
        **_draw_motion(found),
        **_draw_errors(found),
    }


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


def _draw_motion(found: ExcitationDesign) -> dict[str, bytes]:
    """Position of each motor with its limits, and its force."""
    motors, rows = found.motors, thinned(len(found.motors))
    mechanism = found.force_model.mechanism
    limits = {check.name: (check.lower, check.upper) for check in found.checks}
    with drawing(len(motors.names), height=1.2) as (figure, axes):
        for k, (ax, name) in enumerate(zip(axes[:, 0], motors.names, strict=True)):
            slides = mechanism.velocity_indices([name])[0] in mechanism.prismatic
            position = ax.plot(motors.time[rows], motors.position[rows, k], color=BLUE)
            for end in limits.get(f"position of {name}", ()):
                if np.isfinite(end):
                    ax.axhline(end, color=BLUE, linestyle="--", linewidth=0.7)
            side = ax.twinx()
            force = side.plot(motors.time[rows], found.forces[rows, k], color=ORANGE, linewidth=0.7)
            side.grid(visible=False)
            side.spines["right"].set_visible(True)
            ax.set(title=drawn(name), ylabel="m" if slides else "rad")
            side.set_ylabel("N" if slides else "N m", color=ORANGE)
        axes[-1, 0].set_xlabel("time (s)")
        handles = [*position, *force]
        figure.legend(handles, ["position", "force"], loc="outside lower center", ncols=2)
        return rendered(figure, "motion")


def _draw_errors(found: ExcitationDesign) -> dict[str, bytes]:
    """Standard errors as bars, before and after."""
    count = min(len(found.parameters), MOST_BARS)
    worst = np.sort(np.argsort(-found.standard_errors, kind="stable")[:count])
    place = np.arange(count)
    with drawing(height=max(1.8, 0.14 * count + 0.8)) as (figure, axes):
        ax = axes[0, 0]
        before, after = found.before.standard_errors[worst], found.standard_errors[worst]
        finite = np.isfinite(before)
        label = "after the logs" if found.after_logs else "first motion"
        ax.barh(place[finite] - 0.2, before[finite], 0.4, color=GREY, label=label)
        ax.barh(place + 0.2, after, 0.4, color=BLUE, label="with this motion")
        for k in place[~finite]:
            ax.text(after[k], k - 0.2, " unidentifiable before", va="center", color=RED, size=5)
        ax.set_yticks(place, [drawn(found.parameters.labels[j]) for j in worst], fontsize=5)
        ax.invert_yaxis()
        ax.set(xscale="log", xlabel="standard error (kg, kg m, kg m², ...)")
        ax.set(title="predicted standard errors")
        plain_log_labels(ax.xaxis, (1.0,))
        figure.legend(loc="outside lower center", ncols=2)
        return rendered(figure, "errors")
