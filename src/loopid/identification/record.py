"""A result as plain numbers, lists and texts, and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.identification.quality import NoiseModel, Quality, Robustness
from loopid.identification.storage import fields_in
from loopid.parameters import Parameter, ParameterSet

if TYPE_CHECKING:
    from loopid.identification.result import FitResult

FORMAT = "loopid fit 1"


def record_of(result: FitResult) -> dict[str, Any]:
    """A record of a result; None stands for what is not finite."""
    return {
        "format": FORMAT,
        "estimator": result.estimator,
        "condition_number": _plain(result.condition_number),
        "degrees_of_freedom": _plain(result.degrees_of_freedom),
        **({"assumed": list(result.assumed)} if result.assumed else {}),
        "parameters": [
            {
                "number": estimate.number,
                "name": estimate.name,
                "unit": estimate.unit,
                "value": _plain(estimate.value),
                "standard_error": _plain(estimate.standard_error),
                "relative_std_percent": _plain(estimate.relative_std),
                "interval_95_percent": [_plain(end) for end in estimate.interval],
            }
            for estimate in result.estimates
        ],
        "covariance": [[_plain(entry) for entry in row] for row in result.covariance],
        "actuators": [_actuator(result, i) for i in range(len(result.actuators))],
    }


def _actuator(result: FitResult, i: int) -> dict[str, Any]:
    record: dict[str, Any] = {
        "name": result.actuators[i],
        "samples": int(result.quality.samples[i]),
        "residual_rms": _plain(result.quality.residual_rms[i]),
        "r_squared": _plain(result.quality.r_squared[i]),
        "weight": _plain(result.weights[i]),
    }
    if result.noise is not None:
        record["noise"] = _noise(result.noise, i)
    if result.robustness is not None:
        record["robustness"] = _robustness(result.robustness, i)
    return record


def _noise(noise: NoiseModel, i: int) -> dict[str, Any]:
    return {
        "coefficients": [_plain(value) for value in noise.coefficients[i]],
        "innovation": _plain(noise.innovation[i]),
        "deviation": _plain(noise.deviation[i]),
        "lag_one": _plain(noise.lag_one[i]),
        "samples": int(noise.samples[i]),
        "effective_samples": _plain(noise.effective_samples[i]),
    }


def _robustness(robustness: Robustness, i: int) -> dict[str, Any]:
    return {
        "scale": _plain(robustness.scale[i]),
        "down_weighted": _plain(robustness.down_weighted[i]),
    }


def fields_of(record: dict[str, Any], source: str | Path) -> dict[str, Any]:
    """Fields of the result in a record.

    Raises
    ------
    DataError
        Naming the source, when something is missing or makes no sense.
    """
    return fields_in(record, _fields, FORMAT, f"{source} is not a saved fit")


def _fields(record: dict[str, Any]) -> dict[str, Any]:
    entries, actuators = record["parameters"], record["actuators"]
    parameters = ParameterSet(tuple(_parameter(entry) for entry in entries))
    names = tuple(str(actuator["name"]) for actuator in actuators)
    n, column = len(parameters), _columns(actuators)
    return {
        "estimator": str(record["estimator"]),
        "parameters": parameters,
        "actuators": names,
        "values": _array((entry["value"] for entry in entries), (n,), "values"),
        "covariance": _array(record["covariance"], (n, n), "the covariance"),
        "condition_number": _number(record["condition_number"]),
        "degrees_of_freedom": _number(record["degrees_of_freedom"]),
        "quality": Quality(column("residual_rms"), column("r_squared"), _counts(actuators)),
        "weights": column("weight"),
        "noise": _noise_model(names, actuators),
        "assumed": tuple(str(name) for name in record.get("assumed", ())),
        "robustness": _robustness_of(actuators),
    }


def _parameter(entry: dict[str, Any]) -> Parameter:
    parsed = Parameter.parse(str(entry["name"]))
    return Parameter(parsed.link, parsed.kind, str(entry["unit"]))


def _noise_model(names: tuple[str, ...], actuators: list[dict[str, Any]]) -> NoiseModel | None:
    if not any("noise" in actuator for actuator in actuators):
        return None
    entries = [actuator["noise"] for actuator in actuators]
    column = _columns(entries)
    return NoiseModel(
        actuators=names,
        coefficients=np.array([entry["coefficients"] for entry in entries], dtype=np.float64),
        innovation=column("innovation"),
        deviation=column("deviation"),
        lag_one=column("lag_one"),
        samples=_counts(entries),
        effective_samples=column("effective_samples"),
    )


def _robustness_of(actuators: list[dict[str, Any]]) -> Robustness | None:
    if not any("robustness" in actuator for actuator in actuators):
        return None
    column = _columns([actuator["robustness"] for actuator in actuators])
    return Robustness(column("scale"), column("down_weighted"))


def _counts(entries: list[dict[str, Any]]) -> IntArray:
    return np.array([int(entry["samples"]) for entry in entries], dtype=np.int64)


def _columns(entries: list[dict[str, Any]]) -> Callable[[str], FloatArray]:
    return lambda key: np.array([_number(entry[key]) for entry in entries])


def _array(rows: Iterable[Any], shape: tuple[int, ...], name: str) -> FloatArray:
    values = np.array(list(rows), dtype=np.float64)
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} must be {' by '.join(map(str, shape))} finite numbers")
    return values


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _plain(value: Any) -> float | None:
    number = float(value)
    return number if math.isfinite(number) else None
