"""A consistent fit as plain numbers, lists and texts, and back."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loopid.arrays import FloatArray
from loopid.identification.storage import fields_in
from loopid.parameters import Parameter, ParameterSet

if TYPE_CHECKING:
    from loopid.consistency.result import ConsistentFit

FORMAT = "loopid consistent fit 1"
TEXTS, NUMBERS = ("regularisation", "solver"), ("strength", "margin")
LISTS = ("bodies", "boundary", "repaired")


def record_of(result: ConsistentFit) -> dict[str, Any]:
    """A record of a result; None stands for what is not finite."""
    cost = result.fit_cost
    return {
        "format": FORMAT,
        "feasible": result.feasible,
        **{name: getattr(result, name) for name in (*TEXTS, *NUMBERS)},
        **{name: list(getattr(result, name)) for name in LISTS},
        "margins": [_plain(value) for value in result.margins],
        "fit_cost": {
            "actuators": list(cost.actuators),
            "unconstrained": [_plain(value) for value in cost.unconstrained],
            "constrained": [_plain(value) for value in cost.constrained],
            "total": _plain(cost.total),
        },
        "standard_parameters": _entries(result.parameters, result.standard_parameters),
        "base_parameters": _entries(result.base_parameters, result.values),
    }


def fields_of(record: dict[str, Any], source: str | Path) -> dict[str, Any]:
    """Fields of the result in a record, those of the cost as a mapping.

    Raises
    ------
    DataError
        Naming the source, when something is missing or makes no sense.
    """
    return fields_in(record, _fields, FORMAT, f"{source} is not a saved consistent fit")


def _fields(record: dict[str, Any]) -> dict[str, Any]:
    parameters, standard = _parsed(record["standard_parameters"])
    base, values = _parsed(record["base_parameters"])
    bodies = tuple(map(str, record["bodies"]))
    if not isinstance(record["feasible"], bool):
        raise ValueError("feasible must be true or false")
    return {
        "parameters": parameters,
        "standard_parameters": standard,
        "base_parameters": base,
        "values": values,
        "feasible": record["feasible"],
        "fit_cost": _cost(record["fit_cost"]),
        "margins": _column(record["margins"], len(bodies)),
        **{name: str(record[name]) for name in TEXTS},
        **{name: float(record[name]) for name in NUMBERS},
        **{name: tuple(map(str, record[name])) for name in LISTS},
    }


def _cost(record: dict[str, Any]) -> dict[str, Any]:
    actuators = tuple(map(str, record["actuators"]))
    return {
        "actuators": actuators,
        "unconstrained": _column(record["unconstrained"], len(actuators)),
        "constrained": _column(record["constrained"], len(actuators)),
        "total": _number(record["total"]),
    }


def _entries(parameters: ParameterSet, values: FloatArray) -> list[dict[str, Any]]:
    return [
        {"name": parameter.label, "unit": parameter.unit, "value": float(value)}
        for parameter, value in zip(parameters, values, strict=True)
    ]


def _parsed(entries: list[dict[str, Any]]) -> tuple[ParameterSet, FloatArray]:
    found = [(Parameter.parse(str(entry["name"])), str(entry["unit"])) for entry in entries]
    names = tuple(Parameter(name.link, name.kind, unit) for name, unit in found)
    values = np.array([float(entry["value"]) for entry in entries], dtype=np.float64)
    if not np.isfinite(values).all():
        raise ValueError("values must be finite numbers")
    return ParameterSet(names), values


def _column(entries: Iterable[Any], count: int) -> FloatArray:
    values = np.array([_number(entry) for entry in entries], dtype=np.float64)
    if values.shape != (count,):
        raise ValueError(f"{len(values)} numbers where {count} belong")
    return values


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _plain(value: Any) -> float | None:
    number = float(value)
    return number if math.isfinite(number) else None
