"""The report of ``loopid payload``: records and tables."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from loopid.errors import RankError
from loopid.experiment import GainFit, PayloadFit
from loopid.report.tables import json_value, plain_table


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
    table = plain_table(f"payload on {found.link}", "", ">value", ">95 % interval", "unit")

    def add(name: str, value: float, interval: list[float], unit: str) -> None:
        table.add_row(name, f"{value:.5g}", "{:.5g} ... {:.5g}".format(*interval), unit)

    keys = ("parameters", "values", "intervals_95_percent", "units")
    for name, value, interval, unit in zip(*(record[key] for key in keys), strict=True):
        add(name, value, interval, unit)
    if "centre" in record:
        told = zip("xyz", record["centre"], record["centre_intervals_95_percent"], strict=True)
        for axis, value, interval in told:
            if value is not None:
                add(f"centre of mass, {axis}", value, interval, "m")
    return [table]


def gains_record(found: GainFit) -> dict[str, Any]:
    """The gains in plain numbers."""
    return {
        "actuators": list(found.actuators),
        "gains": json_value(found.gains),
        "intervals_95_percent": json_value(found.intervals()),
    }


def gains_tables(found: GainFit) -> list[Table]:
    """One row a motor."""
    title = "true force over logged force: multiply force_scale of the mapping by it"
    table = plain_table(title, "motor", ">gain", ">95 % interval")
    for name, gain, span in zip(found.actuators, found.gains, found.intervals(), strict=True):
        table.add_row(name, f"{gain:.4f}", "{:.4f} ... {:.4f}".format(*span))
    return [table]
