"""Reports of ``loopid predict`` and ``loopid payload``: records, tables, charts and files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any

import numpy as np
from rich.table import Table

from loopid.arguments import FloatArray, checked
from loopid.diagnosis.gains import GainFit
from loopid.diagnosis.payload import MotorMasses, PayloadFit
from loopid.errors import RankError, counted
from loopid.identification.outcome import ROUGH
from loopid.identification.prediction import Prediction
from loopid.identification.verdict import GOOD
from loopid.numbers import interval, number, with_error
from loopid.plots.chart import Chart, Mark
from loopid.plots.pictures import forces_chart, motors_panel, numbered
from loopid.plots.structure import robot_chart
from loopid.records import json_value
from loopid.report.look import json_fields, table_of
from loopid.report.page import Card, Figure, Report, Section, Tone, panel_table
from loopid.robot.robot import Robot


@checked
def prediction_report(robot: Robot, predictions: Sequence[Prediction]) -> Report:
    """Forces of logs beside those of a fit.

    Parameters
    ----------
    robot : Robot
    predictions : sequence of Prediction
        One a log.

    Returns
    -------
    Report

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
    >>> prediction = found.fit.predict("urdf/logs/five_bar.csv")
    >>> loopid.report.prediction_report(robot, [prediction]).title
    'five_bar: forces predicted'
    """
    errors = (
        (part, name, found.recording.name)
        for found in predictions
        for part, name in zip(
            found.relative_errors.tolist(), found.recording.actuators, strict=True
        )
        if np.isfinite(part)
    )
    worst, motor, log = max(errors, default=(np.nan, "", ""))
    tone: Tone = "good" if worst <= GOOD else "rough" if worst <= ROUGH else "bad"
    word = tone.capitalize()
    samples = sum(int(found.moving.samples.sum()) for found in predictions)
    share, where = f"{number(100 * worst, 2)} %", f"({motor}, {log})"
    verdict = (
        f"{word} predictions: where motors move, errors are at most {share} of a "
        f"motor's force {where}, over {samples:,} samples."
    )
    gauge = (worst, GOOD, ROUGH) if motor else ()
    if not motor:
        verdict = "Predictions that nothing judges: no motor moves with a force that is logged."
        tone, word, share, where = "info", "Not judged", "-", ""
    shown = dict[str, tuple[Prediction, Table]]()  # by name
    for found in predictions:
        name = stem = PurePath(found.recording.name).name
        while name in shown:  # two logs of one name in different folders
            name = f"{stem}_{len(shown) + 1}"
        shown[name] = found, _prediction_table(robot, found)
    return Report(
        name="prediction",
        title=f"{robot.name}: forces predicted",
        verdict=verdict,
        card=Card(
            tone=tone,
            word=word,
            use="predictions of forces where motors move",
            figures=(
                Figure(share, f"of its force: largest error {where}", gauge=gauge),
                Figure(f"{samples:,}", f"samples in motion, in {counted(len(shown), 'log')}"),
            ),
            next="write the fit as C for a controller."
            if tone == "good"
            else "identify from this log, too.",
        ),
        pictures=lambda: (robot_chart(robot, worst=motor),),
        record=lambda: {"recordings": [*map(_prediction_record, predictions)]},
        brief=[table for _, table in shown.values()],
        sections=lambda: [
            Section(
                name, (table, forces_chart(robot, found, worst=motor, name=f"prediction_{name}"))
            )
            for name, (found, table) in shown.items()
        ],
        results=lambda _: {f"prediction_{name}.csv": f.csv() for name, (f, _) in shown.items()},
    )


def _prediction_record(found: Prediction) -> dict[str, Any]:
    rest = found.standing
    return {
        **json_fields(found.recording, "name", "actuators", "wrenches"),
        "moving": {"samples": found.moving.samples, "rms": found.moving.residual_rms},
        "standing_or_saturated": {"samples": rest.samples, "rms": rest.residual_rms},
        "relative_errors": found.relative_errors,
        "in_95_percent_band": found.inside,
        "dropped": [str(dropped) for dropped in found.recording.dropped],
    }


def _prediction_table(robot: Robot, found: Prediction) -> Table:
    motors, moving, rest = found.recording.actuators, found.moving, found.standing
    units = [robot.units(motor)[1] for motor in motors]
    columns = {
        "motor": lambda k: numbered(robot, motors[k]),
        ">moving": lambda k: f"{moving.samples[k]:,}",
        ">RMS error": lambda k: f"{number(float(moving.residual_rms[k]))} {units[k]}",
        ">of its force": lambda k: f"{number(100 * float(found.relative_errors[k]), 2)} %",
        ">at rest": lambda k: f"{rest.samples[k]:,}",
        ">RMS error at rest": lambda k: f"{number(float(rest.residual_rms[k]))} {units[k]}",
    }
    return table_of(f"prediction of {found.recording.name}", columns, range(len(motors)))


@checked
def payload_report(robot: Robot, found: PayloadFit) -> Report:
    """A body that was carried.

    Parameters
    ----------
    robot : Robot
    found : PayloadFit

    Returns
    -------
    Report

    Examples
    --------
    >>> import dataclasses, loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    >>> model = loopid.force_model(robot, "gravity", "Fc,Fv")
    >>> loaded = dataclasses.replace(run, force=1.1 * run.force)
    >>> found = loopid.identify_payload(model, run, loaded, link="left_coupler")
    >>> loopid.report.payload_report(robot, found).name
    'payload'
    """
    record, ends = _payload_record(found), found.intervals()
    motors, mass, centre = found.motors, record["mass"], _centre(record)
    apart = None if motors is None else motors.disagreement
    verdict, chips = "The forces determine no mass of the payload alone", list[tuple[Tone, str]]()
    card, charts = Card(tone="rough", word="No mass", use=verdict), list[Chart]()
    figures = [Figure(_of_width(x, own), f"centre along {axis}", "m") for axis, x, own in centre]
    if mass is not None:
        span, differ = ends[record["values"].index(mass)], ""
        weight, between = _of_width(mass, span), interval(*span).replace("...", "to")
        if motors is not None and motors.actuators:
            each = f"{motors.values.min():.3g} to {motors.values.max():.3g}"
            differ = f", on which motors disagree ({each} kg)" * bool(apart)
            chips.append(("rough", "Motors disagree") if apart else ("good", "Motors agree"))
            figures.append(Figure(each, "mass by each motor alone", "kg"))
            charts.append(_masses_chart(robot, motors, mass, span))
        said = ", ".join(f"{axis} {_of_width(x, own)}" for axis, x, own in centre)
        where = f"at {said} m in the link's frame" if said else "undetermined"
        verdict = f"The payload weighs {weight} kg (95 %: {between}){differ}, its centre is {where}"
        card = Card(
            tone="rough" if apart else "good",
            word=f"{weight} kg",
            use=f"on {found.link}, 95 %: {between} kg",
            chips=tuple(chips),
            figures=tuple(figures),
            next=f"{apart.do}." if apart else "",
        )
    columns = {
        "": lambda row: row[0],
        ">value": lambda row: f"{number(row[1])} {row[2]}",
        ">95 % interval": lambda row: interval(*row[3]),
    }
    rows = [
        *zip(record["parameters"], record["values"], record["units"], ends, strict=True),
        *((f"centre of mass, {axis}", x, "m", own) for axis, x, own in centre),
    ]
    table, clear = table_of("", columns, rows), sum(low > 0 or high < 0 for low, high in ends)
    return Report(
        name="payload",
        title=f"Payload on {found.link}",
        verdict=f"{verdict}; {clear} of {len(ends)} values are significant.",
        record=lambda: record,
        brief=[table, *(panel_table(chart.panels[0]) for chart in charts)],
        card=card,
        findings=() if apart is None else (apart,),
        pictures=lambda: (robot_chart(robot),),
        sections=lambda: [
            *(Section("Mass by each motor", (chart,), short="Motors") for chart in charts),
            Section("All values", (table,)),
        ],
    )


def _masses_chart(robot: Robot, motors: MotorMasses, mass: float, span: FloatArray) -> Chart:
    """The mass by each motor alone beside that by all of them."""
    title, words = "Mass by each motor alone (kg)", ("by all motors", "differs", "agrees")
    panel = motors_panel(robot, title, _by_motor(motors, motors.values), mass, words)
    shade = Mark("95 % by all motors", span[:1], np.zeros(1), "other", "shade", span[1:])
    caption = "As if the gain of that motor were right; filled where its interval leaves it out."
    return Chart("motor_masses", caption, "", (replace(panel, marks=(shade, *panel.marks)),))


def _by_motor(found: MotorMasses | GainFit, values: FloatArray) -> dict[str, list[float]]:
    """Values with the ends of their intervals, and NaN where they are undetermined."""
    numbers = np.column_stack([values, found.intervals()]).tolist()
    unknown = {name: [np.nan] * 3 for name in found.undetermined}
    return dict(zip(found.actuators, numbers, strict=True)) | unknown


def _of_width(value: float, ends: Sequence[float]) -> str:
    """A value to two digits of half the width of its interval."""
    return with_error(value, (ends[1] - ends[0]) / 2)[0]


def _centre(record: dict[str, Any]) -> list[tuple[str, float, list[float]]]:
    """Axes that the forces determine, with the centre of mass and its interval along them."""
    ends = record["centre_intervals_95_percent"] or ()
    known = zip("xyz", record["centre"] or (), ends, strict=False)
    return [(axis, x, own) for axis, x, own in known if x is not None]


def _payload_record(found: PayloadFit) -> dict[str, Any]:
    """Mass and centre where they are determined."""
    try:
        mass, (centre, spread) = found.mass, found.centre()
    except RankError:
        mass = centre = spread = None  # type: ignore[assignment]
    motors = found.motors and {
        **json_fields(found.motors, "actuators", "values", "chance", "undetermined"),
        "intervals_95_percent": found.motors.intervals(),
    }
    record: dict[str, Any] = json_value(
        {
            "link": found.link,
            "parameters": found.base.expressions,
            "units": [parameter.unit for parameter in found.parameters],
            **json_fields(found, "values", "standard_parameters"),
            "intervals_95_percent": found.intervals(),
            "mass": mass,
            "centre": centre,
            "centre_intervals_95_percent": spread,
            "motors": motors,
        }
    )
    return record


@checked
def gains_report(robot: Robot, found: GainFit) -> Report:
    """Gains of drives, by a payload that is known.

    Parameters
    ----------
    robot : Robot
    found : GainFit

    Returns
    -------
    Report

    Examples
    --------
    >>> import loopid, numpy as np
    >>> from loopid.diagnosis.gains import GainFit
    >>> gains = GainFit(
    ...     ("left_crank_joint",), np.ones(1), 1e-4 * np.eye(1), 50.0, ("right_crank_joint",))
    >>> loopid.report.gains_report(loopid.load("five_bar"), gains).verdict.partition(",")[0]
    'True forces are 1 to 1 times the logged ones'
    """
    ends, count = found.intervals(), len(found.gains)
    off = sum(low > 1 or high < 1 for low, high in ends)
    panel = motors_panel(robot, "True force over logged force", _by_motor(found, found.gains), 1.0)
    chart = Chart("gains", "A gain of 1 says that the log is right.", "", (panel,))
    unknown = f"; undetermined: {', '.join(found.undetermined)}" if found.undetermined else ""
    span = f"{found.gains.min():.3g} to {found.gains.max():.3g}"
    step = "multiply force_scale of the mapping by the gains." if off else ""
    return Report(
        name="gains",
        title="Gains of the drives",
        verdict=(
            f"True forces are {span} times the logged ones, clearly not 1 for {off} of {count} "
            f"motors{unknown}.{f' Next: {step}' if step else ''}"
        ),
        card=Card(
            tone="rough" if off else "good",
            word="Gains are off" if off else "Gains are right",
            use=f"for {off or count} of {count} motors{unknown}",
            figures=(Figure(span, "true force over logged force"),),
            next=step,
        ),
        record=lambda: (
            json_fields(found, "actuators", "gains", "undetermined")
            | {"intervals_95_percent": ends}
        ),
        brief=[panel_table(panel)],
        pictures=lambda: (robot_chart(robot),),
        sections=lambda: [Section("Gains by motor", (chart,))],
    )
