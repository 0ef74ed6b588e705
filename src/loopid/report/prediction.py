"""The report of ``loopid predict``: record, table, figure and files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

from rich.table import Table

from loopid.identification import Quality
from loopid.prediction import Prediction
from loopid.report.figures import BLUE, GREY, RED, drawing, rendered, thinned
from loopid.report.tables import json_value, plain_table
from loopid.robot import Mechanism


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
    tables: list[Table] = []
    for found in predictions:
        columns = "motor", ">moving", ">RMS error", ">R²", ">standing", ">RMS error"
        table = plain_table(f"prediction of {found.recording.name}", *columns)
        for k, motor in enumerate(found.recording.actuators):
            cells = f"{found.moving.residual_rms[k]:.4g}", f"{found.moving.r_squared[k]:.4f}"
            table.add_row(
                motor,
                f"{found.moving.samples[k]:,}",
                *cells,
                f"{found.standing.samples[k]:,}",
                f"{found.standing.residual_rms[k]:.4g}" if found.standing.samples[k] else "-",
            )
        tables.append(table)
    return tables


def prediction_files(
    mechanism: Mechanism, predictions: Sequence[Prediction]
) -> dict[str, bytes | str]:
    """The record, and a table and a figure of each recording, by file name."""
    record = prediction_record(predictions)
    files: dict[str, bytes | str] = {
        "prediction.json": json.dumps(record, indent=2, ensure_ascii=False) + "\n"
    }
    for found in predictions:
        stem = f"prediction_{PurePath(found.recording.name).name}"
        while f"{stem}.csv" in files:  # two logs of one name in different folders
            stem += "_"
        files[f"{stem}.csv"] = found.csv()
        files |= draw_prediction(mechanism, found, stem)
    return files


def draw_prediction(mechanism: Mechanism, found: Prediction, name: str) -> dict[str, bytes]:
    """Measured and predicted forces of each motor, and what is left, over one time axis."""
    recording = found.recording
    rows = thinned(len(recording))
    time = recording.motion.time[rows]
    with drawing(len(recording.actuators), height=1.3) as (figure, axes):
        for k, (ax, motor) in enumerate(zip(axes[:, 0], recording.actuators, strict=True)):
            sliding = mechanism.velocity_indices([motor])[0] in mechanism.prismatic
            ax.plot(time, recording.force[rows, k], color=GREY, linewidth=0.6)
            ax.plot(time, found.predicted[rows, k], color=RED)
            ax.plot(time, found.residual[rows, k], color=BLUE, linewidth=0.6)
            ax.set_title(f"{motor}: R² {found.moving.r_squared[k]:.3f}", parse_math=False)
            ax.set_ylabel(f"force ({'N' if sliding else 'N m'})")
            ax.sharex(axes[0, 0])
        axes[-1, 0].set_xlabel("time (s)")
        labels = "measured", "predicted", "measured less predicted"
        figure.legend(axes[0, 0].lines, labels, loc="outside lower center", ncols=3)
        return rendered(figure, name)
