"""Reports of ``loopid predict`` and ``loopid payload``: records, tables, charts and files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any

import numpy as np
from rich.table import Table

from loopid.arguments import FloatArray
from loopid.diagnosis.gains import GainFit
from loopid.diagnosis.payload import MotorMasses, PayloadFit
from loopid.errors import RankError
from loopid.identification.prediction import Prediction
from loopid.identification.verdict import GOOD, ROUGH
from loopid.numbers import interval, number, with_error
from loopid.plots.chart import Chart, Mark
from loopid.plots.pictures import forces_chart, motors_panel
from loopid.plots.structure import force_unit, robot_chart
from loopid.report.look import json_fields, json_value, plain_table
from loopid.report.page import Card, Figure, Report, Section, Tone, panel_table
from loopid.robot.robot import Robot


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
    grade = "Good" if worst <= GOOD else "Rough" if worst <= ROUGH else "Bad"
    tones: dict[str, Tone] = {"Good": "good", "Rough": "rough", "Bad": "bad"}
    samples = sum(int(found.moving.samples.sum()) for found in predictions)
    share, where = f"{number(100 * worst, 2)} %", f"({motor}, {log})"
    gauge = (worst, GOOD, ROUGH) if np.isfinite(worst) else ()
    tables, names = [_prediction_table(robot, each) for each in predictions], list[str]()
    for found in predictions:
        name = stem = PurePath(found.recording.name).name
        while name in names:  # two logs of one name in different folders
            name = f"{stem}_{len(names) + 1}"
        names.append(name)
    figures = (
        Figure(share, f"of its force: largest error {where}", gauge=gauge),
        Figure(f"{samples:,}", "samples in motion"),
        Figure(str(len(predictions)), "log" if len(predictions) == 1 else "logs"),
    )
    return Report(
        name="prediction",
        title=f"{robot.name}: forces predicted",
        verdict=(
            f"{grade} predictions: where motors move, errors are at most {share} of a motor's "
            f"force {where}, over {samples:,} samples."
        ),
        card=Card(
            tone=tones[grade],
            word=grade,
            use="predictions of forces where motors move",
            figures=figures,
            next="write the fit as C for a controller."
            if grade == "Good"
            else "identify from this log, too.",
        ),
        pictures=lambda: (robot_chart(robot, worst=motor),),
        record={"recordings": [*map(_prediction_record, predictions)]},
        brief=tables,
        sections=lambda: [
            Section(
                name,
                (table, forces_chart(robot, found, worst=motor, name=f"prediction_{name}")),
            )
            for name, found, table in zip(names, predictions, tables, strict=True)
        ],
        results=lambda: {
            f"prediction_{name}.csv": found.csv()
            for name, found in zip(names, predictions, strict=True)
        },
    )


def _prediction_record(found: Prediction) -> dict[str, Any]:
    rest = found.standing
    record: dict[str, Any] = json_value(
        {
            **json_fields(found.recording, "name", "actuators", "wrenches"),
            "moving": {"samples": found.moving.samples, "rms": found.moving.residual_rms},
            "standing_or_saturated": {"samples": rest.samples, "rms": rest.residual_rms},
            "relative_errors": found.relative_errors,
            "in_95_percent_band": found.inside,
            "dropped": [str(dropped) for dropped in found.recording.dropped],
        }
    )
    return record


def _prediction_table(robot: Robot, found: Prediction) -> Table:
    motors, moving, rest = found.recording.actuators, found.moving, found.standing
    columns = "motor", ">moving", ">RMS error", ">of its force", ">at rest", ">RMS error", "unit"
    rows = zip(
        motors,
        (f"{n:,}" for n in moving.samples.tolist()),
        map(number, moving.residual_rms.tolist()),
        (f"{number(100 * part, 2)} %" for part in found.relative_errors.tolist()),
        (f"{n:,}" for n in rest.samples.tolist()),
        map(number, rest.residual_rms.tolist()),
        (force_unit(robot, motor) for motor in motors),
        strict=True,
    )
    return plain_table(f"prediction of {found.recording.name}", columns, rows)


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
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> run = loopid.prepare(robot, loopid.read_log(robot, "urdf/logs/five_bar.csv"))
    >>> model = loopid.force_model(robot, "gravity", "Fc,Fv")
    >>> found = loopid.identify_payload(model, run, run, link="left_coupler")
    >>> loopid.report.payload_report(robot, found).name
    'payload'
    """
    told, motors, ends = _payload_record(found), _determined(found), found.intervals()
    apart = None if motors is None else motors.disagreement
    sure = sum(low > 0 or high < 0 for low, high in ends)
    verdict, clear = "The forces determine no mass of the payload alone", f"{sure} of {len(ends)}"
    rows = [
        (name, f"{number(value)} {unit}", interval(*span))
        for name, value, span, unit in zip(
            *(told["parameters"], told["values"], ends, told["units"]), strict=True
        )
    ]
    card, charts = Card(tone="rough", word="No mass", use=verdict), list[Chart]()
    if told["mass"] is not None:
        span = ends[told["values"].index(told["mass"])]
        mass, between = _of_width(told["mass"], span), interval(*span).replace("...", "to")
        said = [f"{axis} {_of_width(x, own)}" for axis, x, own in _centre(found)]
        centre = f"at {', '.join(said)} m in the link's frame" if said else "undetermined"
        differ = "" if apart is None else f", on which motors disagree ({_span(motors)} kg)"
        verdict = f"The payload weighs {mass} kg (95 %: {between}){differ}, its centre is {centre}"
        rows += [
            (f"centre of mass, {axis}", f"{number(x)} m", interval(*own))
            for axis, x, own in _centre(found)
        ]
        card = _payload_card(found, mass, between)
        charts = [] if motors is None else [_masses_chart(robot, motors, told["mass"], span)]
    table = plain_table("", ("", ">value", ">95 % interval"), rows)
    return Report(
        name="payload",
        title=f"Payload on {found.link}",
        verdict=f"{verdict}; {clear} values are significant.",
        record=told,
        brief=[table, *(panel_table(chart.panels[0]) for chart in charts)],
        card=card,
        findings=() if apart is None else (apart,),
        pictures=lambda: (robot_chart(robot),),
        sections=lambda: [
            *(Section("Mass by each motor", (chart,), short="Motors") for chart in charts),
            Section("All values", (table,)),
        ],
    )


def _determined(found: PayloadFit) -> MotorMasses | None:
    """The mass by each motor, where any determines it."""
    return found.motors if found.motors is not None and found.motors.actuators else None


def _payload_card(found: PayloadFit, mass: str, between: str) -> Card:
    """The mass, and whether the motors agree on it."""
    motors, chips = _determined(found), list[tuple[Tone, str]]()
    figures = [
        Figure(_of_width(x, own), f"centre of mass along {axis}", "m")
        for axis, x, own in _centre(found)
    ]
    apart = None if motors is None else motors.disagreement
    if motors is not None:
        chips.append(("rough", "Motors disagree") if apart else ("good", "Motors agree"))
        figures.append(Figure(_span(motors), "mass by each motor alone", "kg"))
    return Card(
        tone="rough" if apart else "good",
        word=f"{mass} kg",
        use=f"on {found.link}, 95 %: {between} kg",
        chips=tuple(chips),
        figures=tuple(figures),
        next=f"{apart.do}." if apart else "",
    )


def _span(motors: MotorMasses | None) -> str:
    return "" if motors is None else f"{motors.values.min():.3g} to {motors.values.max():.3g}"


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


def _of_width(value: float, ends: FloatArray) -> str:
    """A value to two digits of half the width of its interval."""
    return with_error(value, float(ends[1] - ends[0]) / 2)[0]


def _centre(found: PayloadFit) -> list[tuple[str, float, FloatArray]]:
    """Axes that the forces tell, with the centre of mass and its interval along them."""
    centre, reach = found.centre()
    axes = zip("xyz", centre.tolist(), reach, strict=True)
    return [(axis, x, ends) for axis, x, ends in axes if np.isfinite(x)]


def _payload_record(found: PayloadFit) -> dict[str, Any]:
    """Mass and centre where they are determined."""
    try:
        mass, (centre, spread) = found.mass, found.centre()
    except RankError:
        mass = centre = spread = None  # type: ignore[assignment]
    motors, known = found.motors, dict[str, Any]()
    if motors is not None:
        known = json_fields(motors, "actuators", "values", "chance", "undetermined")
        known["intervals_95_percent"] = motors.intervals()
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
            "motors": known or None,
        }
    )
    return record


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
    ends = found.intervals()
    off = sum(low > 1 or high < 1 for low, high in ends)
    title = "True force over logged force: multiply force_scale of the mapping by it"
    panel = motors_panel(robot, title, _by_motor(found, found.gains), 1.0)
    chart = Chart("gains", "A gain of 1 says that the log is right.", "", (panel,))
    unknown = f"; undetermined: {', '.join(found.undetermined)}" if found.undetermined else ""
    span = f"{found.gains.min():.3g} to {found.gains.max():.3g}"
    return Report(
        name="gains",
        title="Gains of the drives",
        verdict=(
            f"True forces are {span} times the logged ones, clearly not 1 for {off} of {len(ends)} "
            f"motors{unknown}."
        ),
        record=json_fields(found, "actuators", "gains", "undetermined")
        | {"intervals_95_percent": json_value(ends)},
        brief=[panel_table(panel)],
        pictures=lambda: (robot_chart(robot),),
        sections=lambda: [Section("Gains by motor", (chart,))],
    )
