"""Reports of ``loopid predict`` and ``loopid payload``: records, tables, figures and files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

from rich.table import Table

from loopid.diagnosis.payload import GainFit, PayloadFit
from loopid.errors import RankError
from loopid.identification.prediction import Prediction
from loopid.identification.result import Quality
from loopid.report.look import (
    BLUE,
    RED,
    THIN,
    drawing,
    drawn,
    force_panels,
    force_unit,
    json_fields,
    json_text,
    json_value,
    plain_table,
    rendered,
    thinned,
)
from loopid.robot.mechanism import Mechanism


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


def prediction_files(
    mechanism: Mechanism, predictions: Sequence[Prediction]
) -> dict[str, bytes | str]:
    """The record, and a table and a figure of each recording, by file name."""
    record = json_text(prediction_record(predictions))
    files: dict[str, bytes | str] = {"prediction.json": record + "\n"}
    for found in predictions:
        stem = f"prediction_{PurePath(found.recording.name).name}"
        while f"{stem}.csv" in files:  # two logs of one name in different folders
            stem += "_"
        files[f"{stem}.csv"] = found.csv()
        files |= draw_prediction(mechanism, found, stem)
    return files


def draw_prediction(mechanism: Mechanism, found: Prediction, name: str) -> dict[str, bytes]:
    """Measured and predicted forces of each motor, and what is left, over one time axis."""
    recording, scores = found.recording, found.moving.r_squared
    rows = thinned(len(recording))
    lines = (
        (recording.force[rows], "measured", THIN),
        (found.predicted[rows], "predicted", {"color": RED}),
        (found.residual[rows], "measured less predicted", {"color": BLUE, "linewidth": 0.6}),
    )
    panels = {
        f"{drawn(motor)}: R² {score:.3f}": force_unit(mechanism, motor)
        for motor, score in zip(recording.actuators, scores, strict=True)
    }
    with drawing(len(panels), height=1.3) as (figure, axes):
        force_panels(figure, axes, recording.motion.time[rows], lines, panels)
        return rendered(figure, name)


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
        return record
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
    for k, axis in enumerate("xyz" if "centre" in record else ""):
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
