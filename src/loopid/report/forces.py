"""Reports of ``loopid predict`` and ``loopid payload``: records, tables, charts and files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np
from rich.table import Table

from loopid.diagnosis.payload import GainFit, PayloadFit
from loopid.errors import RankError
from loopid.identification.prediction import Prediction
from loopid.identification.result import Quality
from loopid.identification.verdict import GOOD, ROUGH
from loopid.plots.pictures import forces_chart
from loopid.report.look import json_fields, json_value, number, plain_table
from loopid.report.page import Report, Section
from loopid.robot.mechanism import Mechanism


def prediction_report(mechanism: Mechanism, predictions: Sequence[Prediction]) -> Report:
    """Forces of logs beside those of a fit."""
    worst, motor, log = max(_errors(predictions), default=(np.nan, "", ""))
    grade = "Good" if worst <= GOOD else "Rough" if worst <= ROUGH else "Bad"
    samples = sum(int(found.moving.samples.sum()) for found in predictions)
    least = np.nanmin([found.moving.r_squared for found in predictions])
    tables, names = prediction_tables(predictions), list[str]()
    for found in predictions:
        name = f"prediction_{PurePath(found.recording.name).name}"
        while name in names:  # two logs of one name in different folders
            name += "_"
        names.append(name)
    return Report(
        name="prediction",
        title=f"{mechanism.name}: forces predicted",
        verdict=(
            f"{grade} predictions: where motors move, errors are at most {100 * worst:.2g} % of a "
            f"motor's force ({motor}, {log}) and R² at least {least:.3f}, over {samples:,} samples."
        ),
        record=prediction_record(predictions),
        brief=tables,
        sections=lambda: [
            Section(found.recording.name, (forces_chart(mechanism, found, name=name), table))
            for name, found, table in zip(names, predictions, tables, strict=True)
        ],
        results=lambda: {
            f"{name}.csv": found.csv() for name, found in zip(names, predictions, strict=True)
        },
    )


def _errors(predictions: Sequence[Prediction]) -> Iterator[tuple[float, str, str]]:
    """Errors in parts of the force where it moves, with motor and recording."""
    for found in predictions:
        run, used = found.recording, found.recording.used
        squares = np.where(used, run.force, 0.0) ** 2
        for k, motor in enumerate(run.actuators):
            size = float(squares[:, k].sum() / max(used[:, k].sum(), 1)) ** 0.5
            if size > 0:
                yield float(found.moving.residual_rms[k]) / size, motor, run.name


def payload_report(found: PayloadFit) -> Report:
    """A body that was carried."""
    told, tables = payload_record(found), payload_tables(found)
    sure = sum(low > 0 or high < 0 for low, high in found.intervals())
    clear = f"{sure} of {len(told['values'])} values differ clearly from zero"
    verdict = f"The forces tell no mass of the payload alone; {clear}."
    if told["mass"] is not None:
        places = ", ".join(number(x, 3) for x in told["centre"])
        low, high = told["intervals_95_percent"][told["values"].index(told["mass"])]
        verdict = (
            f"The payload weighs {told['mass']:.4g} kg (95 %: {low:.4g} to {high:.4g}), its centre "
            f"is at ({places}) m in the link's frame, and {clear}."
        )
    return Report(
        name="payload",
        title=f"Payload on {found.link}",
        verdict=verdict,
        record=told,
        brief=tables,
        sections=lambda: [Section("Payload", tuple(tables))],
    )


def gains_report(found: GainFit) -> Report:
    """Gains of drives, by a payload that is known."""
    off, tables = [low > 1 or high < 1 for low, high in found.intervals()], gains_tables(found)
    return Report(
        name="gains",
        title="Gains of the drives",
        verdict=(
            f"True forces are {found.gains.min():.3g} to {found.gains.max():.3g} times the logged "
            f"ones, clearly not 1 for {sum(off)} of {len(off)} motors."
        ),
        record=gains_record(found),
        brief=tables,
        sections=lambda: [Section("Gains", tuple(tables))],
    )


def prediction_record(predictions: Sequence[Prediction]) -> dict[str, Any]:
    """Errors of all recordings, in plain numbers."""
    return {
        "recordings": [
            {
                "name": found.recording.name,
                "actuators": list(found.recording.actuators),
                "moving": _quality(found.moving),
                "standing_or_saturated": _quality(found.standing),
                "dropped": [str(dropped) for dropped in found.recording.dropped],
                "wrenches": list(found.recording.wrenches),
            }
            for found in predictions
        ]
    }


def _quality(quality: Quality) -> dict[str, Any]:
    return {
        "samples": quality.samples.tolist(),
        "rms": json_value(quality.residual_rms),
        "r_squared": json_value(quality.r_squared),
    }


def prediction_tables(predictions: Sequence[Prediction]) -> list[Table]:
    """One table a recording."""
    columns = "motor", ">moving", ">RMS error", ">R²", ">standing", ">RMS error"
    return [
        plain_table(f"prediction of {found.recording.name}", columns, found.rows)
        for found in predictions
    ]


def payload_record(found: PayloadFit) -> dict[str, Any]:
    """The payload in plain numbers; mass and centre where the forces tell them."""
    record = {
        "link": found.link,
        "parameters": list(found.base.expressions),
        "units": [parameter.unit for parameter in found.parameters],
        "values": json_value(found.values),
        "intervals_95_percent": json_value(found.intervals()),
    }
    try:
        centre, spread = found.centre()
    except RankError:
        told = "mass", "centre", "centre_intervals_95_percent"
        return record | dict.fromkeys(told)
    return record | {
        "mass": found.mass,
        "centre": json_value(centre),
        "centre_intervals_95_percent": json_value(spread),
    }


def payload_tables(found: PayloadFit) -> list[Table]:
    """What the forces tell of the payload, and its mass and centre where they do."""
    record = payload_record(found)
    keys = ("parameters", "values", "intervals_95_percent", "units")
    told = list(zip(*(record[key] for key in keys), strict=True))
    for k, axis in enumerate("xyz" if record["centre"] else ""):
        if record["centre"][k] is not None:
            reach = record["centre_intervals_95_percent"][k]
            told.append((f"centre of mass, {axis}", record["centre"][k], reach, "m"))
    rows = ((name, f"{x:.5g}", "{:.5g} ... {:.5g}".format(*span), u) for name, x, span, u in told)
    return [plain_table(f"payload on {found.link}", ("", ">value", ">95 % interval", "unit"), rows)]


def gains_record(found: GainFit) -> dict[str, Any]:
    """The gains in plain numbers."""
    return {
        **json_fields(found, "actuators", "gains"),
        "intervals_95_percent": json_value(found.intervals()),
    }


def gains_tables(found: GainFit) -> list[Table]:
    """One row a motor."""
    rows = (
        (name, f"{gain:.4f}", "{:.4f} ... {:.4f}".format(*span))
        for name, gain, span in zip(found.actuators, found.gains, found.intervals(), strict=True)
    )
    title = "true force over logged force: multiply force_scale of the mapping by it"
    return [plain_table(title, ("motor", ">gain", ">95 % interval"), rows)]
