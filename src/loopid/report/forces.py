"""Reports of ``loopid predict`` and ``loopid payload``: records, tables, charts and files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np
from rich.table import Table

from loopid.arguments import FloatArray
from loopid.diagnosis.gains import GainFit
from loopid.diagnosis.payload import PayloadFit
from loopid.errors import RankError
from loopid.identification.prediction import Prediction
from loopid.identification.verdict import GOOD, ROUGH
from loopid.numbers import interval, number, with_error
from loopid.plots.pictures import forces_chart
from loopid.plots.structure import force_unit, robot_chart
from loopid.report.look import json_fields, json_value, plain_table
from loopid.report.page import Card, Figure, Report, Section, Tone
from loopid.robot.robot import Robot


def prediction_report(robot: Robot, predictions: Sequence[Prediction]) -> Report:
    """Forces of logs beside those of a fit."""
    worst, motor, log = max(_errors(predictions), default=(np.nan, "", ""))
    grade = "Good" if worst <= GOOD else "Rough" if worst <= ROUGH else "Bad"
    tones: dict[str, Tone] = {"Good": "good", "Rough": "rough", "Bad": "bad"}
    samples = sum(int(found.moving.samples.sum()) for found in predictions)
    tables, names = [_prediction_table(robot, each) for each in predictions], list[str]()
    for found in predictions:
        name = stem = PurePath(found.recording.name).name
        while name in names:  # two logs of one name in different folders
            name = f"{stem}_{len(names) + 1}"
        names.append(name)
    return Report(
        name="prediction",
        title=f"{robot.name}: forces predicted",
        verdict=(
            f"{grade} predictions: where motors move, errors are at most "
            f"{number(100 * worst, 2)} % of a motor's force ({motor}, {log}), over {samples:,} "
            "samples."
        ),
        card=Card(
            tone=tones[grade],
            word=grade,
            use="predictions of forces where motors move",
            figures=(
                Figure(
                    f"{number(100 * worst, 2)} %",
                    f"of its force: largest error ({motor}, {log})",
                    gauge=(worst, GOOD, ROUGH) if np.isfinite(worst) else (),
                ),
                Figure(f"{samples:,}", "samples in motion"),
                Figure(str(len(predictions)), "log" if len(predictions) == 1 else "logs"),
            ),
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


def _errors(predictions: Sequence[Prediction]) -> Iterator[tuple[float, str, str]]:
    """Errors in parts of the force where it moves, with motor and recording."""
    for found in predictions:
        for motor, part in zip(found.recording.actuators, found.relative_errors, strict=True):
            if np.isfinite(part):
                yield float(part), motor, found.recording.name


def _prediction_record(found: Prediction) -> dict[str, Any]:
    parts = {"moving": found.moving, "standing_or_saturated": found.standing}
    return {
        "name": found.recording.name,
        "actuators": list(found.recording.actuators),
        **{
            part: json_fields(quality, "samples") | {"rms": json_value(quality.residual_rms)}
            for part, quality in parts.items()
        },
        "relative_errors": json_value(found.relative_errors),
        "in_95_percent_band": json_value(found.inside),
        "dropped": [str(dropped) for dropped in found.recording.dropped],
        "wrenches": list(found.recording.wrenches),
    }


def _prediction_table(robot: Robot, found: Prediction) -> Table:
    columns = "motor", ">moving", ">RMS error", ">of its force", ">at rest", ">RMS error", "unit"
    rows = (
        (
            motor,
            f"{n:,}",
            number(rms),
            f"{number(100 * part, 2)} %",
            f"{rest:,}",
            number(error),
            force_unit(robot, motor),
        )
        for motor, n, rms, part, rest, error in zip(
            found.recording.actuators,
            *(found.moving.samples, found.moving.residual_rms, found.relative_errors),
            *(found.standing.samples, found.standing.residual_rms),
            strict=True,
        )
    )
    return plain_table(f"prediction of {found.recording.name}", columns, rows)


def payload_report(found: PayloadFit) -> Report:
    """A body that was carried."""
    told = _payload_record(found)
    spans = [interval(*ends) for ends in found.intervals()]
    sure = sum(low > 0 or high < 0 for low, high in found.intervals())
    clear = f"{sure} of {len(spans)} values are significant"
    verdict = f"The forces determine no mass of the payload alone; {clear}."
    if told["mass"] is not None:
        at = told["values"].index(told["mass"])
        mass, span = _of_width(told["mass"], found.intervals()[at]), spans[at]
        verdict = (
            f"The payload weighs {mass} kg (95 %: {span.replace('...', 'to')})"
            f"{_motors_said(found)}, {_centre_said(found)}; {clear}."
        )
    numbers = zip(told["parameters"], told["values"], spans, told["units"], strict=True)
    rows = [(name, f"{number(value)} {unit}", span) for name, value, span, unit in numbers]
    if told["mass"] is not None:
        rows += [
            (f"centre of mass, {axis}", f"{number(x)} m", interval(*ends))
            for axis, x, ends in _centre(found)
        ]
    tables = [plain_table("", ("", ">value", ">95 % interval"), rows)]
    if (motors := found.motors) is not None:
        by = zip(motors.actuators, motors.values, motors.intervals(), strict=True)
        masses = [(name, _of_width(value, ends), interval(*ends)) for name, value, ends in by]
        masses += [(name, "undetermined", "-") for name in motors.undetermined]
        title = "mass by each motor alone, as if its gain were right"
        tables.append(plain_table(title, ("motor", ">kg", ">95 % interval"), masses))
    return Report(
        name="payload",
        title=f"Payload on {found.link}",
        verdict=verdict,
        record=told,
        brief=tables,
        card=_payload_card(found, told, verdict),
        findings=() if motors is None or motors.disagreement is None else (motors.disagreement,),
    )


def _payload_card(found: PayloadFit, told: dict[str, Any], verdict: str) -> Card:
    """The mass, and whether the motors agree on it."""
    if told["mass"] is None:
        return Card(tone="rough", word="No mass", use=verdict)
    motors = found.motors
    apart = None if motors is None else motors.disagreement
    ends = found.intervals()[told["values"].index(told["mass"])]
    figures = [
        Figure(_of_width(x, own), f"centre of mass along {axis}", "m")
        for axis, x, own in _centre(found)
    ]
    if motors is not None:
        span = f"{motors.values.min():.3g} to {motors.values.max():.3g}"
        figures.append(Figure(span, "mass by each motor alone", "kg"))
    return Card(
        tone="rough" if apart else "good",
        word=f"{_of_width(told['mass'], ends)} kg",
        use=f"on {found.link}, 95 %: {interval(*ends).replace('...', 'to')} kg",
        chips=(("rough", "Motors disagree") if apart else ("good", "Motors agree"),)
        if motors is not None
        else (),
        figures=tuple(figures),
        next=apart.do if apart else "",
    )


def _of_width(value: float, ends: FloatArray) -> str:
    """A value to two digits of half the width of its interval."""
    return with_error(value, float(ends[1] - ends[0]) / 2)[0]


def _motors_said(found: PayloadFit) -> str:
    """On what motors disagree, if they do."""
    motors = found.motors
    if motors is None or not motors.disagreement:
        return ""
    return f", on which motors disagree ({motors.values.min():.3g} to {motors.values.max():.3g} kg)"


def _centre(found: PayloadFit) -> list[tuple[str, float, FloatArray]]:
    """Axes that the forces tell, with the centre of mass and its interval along them."""
    centre, reach = found.centre()
    axes = zip("xyz", centre.tolist(), reach, strict=True)
    return [(axis, x, ends) for axis, x, ends in axes if np.isfinite(x)]


def _centre_said(found: PayloadFit) -> str:
    """Where the centre of mass is, along the axes where it is determined."""
    told = [f"{axis} {_of_width(x, ends)}" for axis, x, ends in _centre(found)]
    if not told:
        return "its centre is undetermined"
    return f"its centre is at {', '.join(told)} m in the link's frame"


def _payload_record(found: PayloadFit) -> dict[str, Any]:
    """Mass and centre where they are determined."""
    try:
        mass, (centre, spread) = found.mass, found.centre()
    except RankError:
        mass = centre = spread = None  # type: ignore[assignment]
    motors = found.motors
    return {
        "link": found.link,
        "parameters": list(found.base.expressions),
        "units": [parameter.unit for parameter in found.parameters],
        "values": json_value(found.values),
        "intervals_95_percent": json_value(found.intervals()),
        "mass": mass,
        "centre": json_value(centre),
        "centre_intervals_95_percent": json_value(spread),
        "standard_parameters": json_value(found.standard_parameters),
        "motors": None
        if motors is None
        else json_fields(motors, "actuators", "values", "chance", "undetermined")
        | {"intervals_95_percent": json_value(motors.intervals())},
    }


def gains_report(found: GainFit) -> Report:
    """Gains of drives, by a payload that is known."""
    ends = found.intervals()
    off = sum(low > 1 or high < 1 for low, high in ends)
    told = zip(found.actuators, found.gains, ends, strict=True)
    rows = [(name, _of_width(gain, span), interval(*span)) for name, gain, span in told]
    rows += [(name, "undetermined", "-") for name in found.undetermined]
    title = "true force over logged force: multiply force_scale of the mapping by it"
    undetermined = f"; undetermined: {', '.join(found.undetermined)}" if found.undetermined else ""
    return Report(
        name="gains",
        title="Gains of the drives",
        verdict=(
            f"True forces are {found.gains.min():.3g} to {found.gains.max():.3g} times the logged "
            f"ones, clearly not 1 for {off} of {len(ends)} motors{undetermined}."
        ),
        record=json_fields(found, "actuators", "gains", "undetermined")
        | {"intervals_95_percent": json_value(ends)},
        brief=[plain_table(title, ("motor", ">gain", ">95 % interval"), rows)],
    )
