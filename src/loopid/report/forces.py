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
from loopid.report.chart import Chart, Mark, Panel
from loopid.report.look import json_fields, json_value, number, plain_table
from loopid.report.page import Report, Section
from loopid.report.structure import force_unit
from loopid.robot.mechanism import Mechanism


class PredictionReport(Report):
    """Forces of logs beside those of a fit."""

    name = "prediction"

    def __init__(self, mechanism: Mechanism, predictions: Sequence[Prediction]) -> None:
        self.mechanism, self.predictions = mechanism, predictions

    @property
    def title(self) -> str:
        logs = ", ".join(found.recording.name for found in self.predictions)
        return f"{self.mechanism.name}: forces predicted for {logs}"

    @property
    def verdict(self) -> str:
        worst, motor, log = max(_errors(self.predictions), default=(np.nan, "", ""))
        grade = "Good" if worst <= GOOD else "Rough" if worst <= ROUGH else "Bad"
        samples = sum(int(found.moving.samples.sum()) for found in self.predictions)
        least = [np.nanmin(found.moving.r_squared) for found in self.predictions]
        return (
            f"{grade} predictions: where motors move, errors are at most {100 * worst:.2g} % of a "
            f"motor's force ({motor}, {log}) and R² at least {np.min(least):.3f}, over "
            f"{samples:,} samples."
        )

    def record(self) -> dict[str, Any]:
        return prediction_record(self.predictions)

    def brief(self) -> list[Table]:
        return prediction_tables(self.predictions)

    def sections(self) -> list[Section]:
        tables = prediction_tables(self.predictions)
        names = self._names()
        return [
            Section(found.recording.name, (prediction_chart(self.mechanism, found, name), table))
            for name, found, table in zip(names, self.predictions, tables, strict=True)
        ]

    def results(self) -> dict[str, bytes | str]:
        """A table of each recording."""
        found = zip(self._names(), self.predictions, strict=True)
        return {f"{name}.csv": each.csv() for name, each in found}

    def _names(self) -> list[str]:
        names = list[str]()
        for found in self.predictions:
            name = f"prediction_{PurePath(found.recording.name).name}"
            while name in names:  # two logs of one name in different folders
                name += "_"
            names.append(name)
        return names


def _errors(predictions: Sequence[Prediction]) -> Iterator[tuple[float, str, str]]:
    """Errors in parts of the force where it moves, with motor and recording."""
    for found in predictions:
        run, used = found.recording, found.recording.used
        squares = np.where(used, run.force, 0.0) ** 2
        for k, motor in enumerate(run.actuators):
            size = float(squares[:, k].sum() / max(used[:, k].sum(), 1)) ** 0.5
            if size > 0:
                yield float(found.moving.residual_rms[k]) / size, motor, run.name


class PayloadReport(Report):
    """A body that was carried."""

    name = "payload"

    def __init__(self, found: PayloadFit) -> None:
        self.found = found

    @property
    def title(self) -> str:
        return f"Payload on {self.found.link}"

    @property
    def verdict(self) -> str:
        told = payload_record(self.found)
        sure = sum(low > 0 or high < 0 for low, high in self.found.intervals())
        clear = f"{sure} of {len(told['values'])} values differ clearly from zero"
        if "mass" not in told:
            return f"The forces tell no mass of the payload alone; {clear}."
        places = (number(x, 3) for x in told["centre"])
        low, high = told["intervals_95_percent"][told["values"].index(told["mass"])]
        return (
            f"The payload weighs {told['mass']:.4g} kg (95 %: {low:.4g} to {high:.4g}), its centre "
            f"is at ({', '.join(places)}) m in the link's frame, and {clear}."
        )

    def record(self) -> dict[str, Any]:
        return payload_record(self.found)

    def brief(self) -> list[Table]:
        return payload_tables(self.found)

    def sections(self) -> list[Section]:
        return [Section("Payload", tuple(payload_tables(self.found)))]


class GainsReport(Report):
    """Gains of drives, by a payload that is known."""

    name = "gains"

    def __init__(self, found: GainFit) -> None:
        self.found = found

    @property
    def title(self) -> str:
        return "Gains of the drives"

    @property
    def verdict(self) -> str:
        found = self.found
        off = [bool(low > 1 or high < 1) for low, high in found.intervals()]
        return (
            f"True forces are {found.gains.min():.3g} to {found.gains.max():.3g} times the logged "
            f"ones, clearly not 1 of {sum(off)} of {len(off)} motors."
        )

    def record(self) -> dict[str, Any]:
        return gains_record(self.found)

    def brief(self) -> list[Table]:
        return gains_tables(self.found)

    def sections(self) -> list[Section]:
        return [Section("Gains", tuple(gains_tables(self.found)))]


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


def prediction_chart(mechanism: Mechanism, found: Prediction, name: str) -> Chart:
    """Measured and predicted forces of each motor, and what is left, over one time axis."""
    run, panels = found.recording, list[Panel]()
    for k, (motor, score) in enumerate(zip(run.actuators, found.moving.r_squared, strict=True)):
        unit, used = force_unit(mechanism, motor), run.used[:, k]
        marks = (
            Mark("measured", run.motion.time, run.force[:, k], "measured"),
            Mark("predicted", run.motion.time, found.predicted[:, k], "fit"),
        )
        left = found.residual[:, k]
        parts = (
            Mark("standing or saturated", run.motion.time, left, "faint"),
            Mark("measured less predicted", run.motion.time, np.where(used, left, np.nan), "file"),
        )
        panels.append(Panel(f"{motor}: force ({unit}), R² {score:.3f}", marks))
        panels.append(Panel(f"residual ({unit})", parts, small=True))
    caption = f"Forces of {run.name}. Drag along time to zoom in, double-click to see all again."
    return Chart(name, caption, "time (s)", tuple(panels), zoom=True)


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
