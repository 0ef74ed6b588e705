"""Base parameters as plain numbers, lists and texts, in YAML or JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loopid.arrays import FloatArray
from loopid.identification.storage import fields_in, read_record, record_text
from loopid.parameters import Parameter, ParameterSet
from loopid.regressors import JointTerms

if TYPE_CHECKING:
    from loopid.export.base_values import BaseValues

FORMAT = "loopid base 1"


def content(values: BaseValues, path: str | Path) -> str:
    """The text of a file of that name."""
    return record_text(path, record_of(values))


def fields(path: str | Path) -> dict[str, Any]:
    """Fields of what a file holds.

    Raises
    ------
    MissingFileError, DataError
    """
    return fields_of(read_record(path), path)


def record_of(values: BaseValues) -> dict[str, Any]:
    """All of it in plain numbers, lists and texts."""
    errors = None if values.covariance is None else np.sqrt(np.diag(values.covariance))
    lists = zip(values.names, values.units, values.expressions, values.terms, strict=True)
    return {
        "format": FORMAT,
        "robot": values.robot,
        "model": values.model,
        "loopid": values.version,
        "rows": list(values.rows),
        "joint_terms": _joint_terms(values.joint_terms),
        "standard_parameters": [
            {"name": parameter.label, "unit": parameter.unit} for parameter in values.standard
        ],
        "base_parameters": [
            {
                "name": name,
                "unit": unit,
                "expression": expression,
                "value": float(values.values[k]),
                **({} if errors is None else {"standard_error": float(errors[k])}),
                "terms": terms,
            }
            for k, (name, unit, expression, terms) in enumerate(lists)
        ],
        "covariance": None if values.covariance is None else values.covariance.tolist(),
    }


def _joint_terms(terms: JointTerms | None) -> dict[str, Any] | None:
    if terms is None:
        return None
    return {
        "joints": list(terms.joints),
        "kinds": list(terms.kinds),
        "dead_zone": float(terms.dead_zone),
        "smoothing": float(terms.smoothing),
    }


def fields_of(record: Mapping[str, Any], source: str | Path) -> dict[str, Any]:
    """Fields of the values in a record.

    Raises
    ------
    DataError
        Naming the source, and what is missing or makes no sense.
    """
    return fields_in(record, _fields, FORMAT, f"{source} holds no base parameters")


def _fields(record: Mapping[str, Any]) -> dict[str, Any]:
    standard = parameter_set(
        (entry["name"], entry["unit"]) for entry in record["standard_parameters"]
    )
    entries, covariance = record["base_parameters"], record.get("covariance")
    return {
        "robot": str(record["robot"]),
        "model": str(record["model"]),
        "version": str(record["loopid"]),
        "rows": tuple(str(row) for row in record["rows"]),
        "joint_terms": joint_terms(record["joint_terms"]),
        "standard": standard,
        "names": tuple(str(entry["name"]) for entry in entries),
        "matrix": _matrix([entry["terms"] for entry in entries], standard.labels),
        "values": np.array([float(entry["value"]) for entry in entries]),
        "covariance": None if covariance is None else np.array(covariance, dtype=np.float64),
    }


def parameter_set(entries: Any) -> ParameterSet:
    """Parameters of pairs of a label and a unit."""
    return ParameterSet(
        tuple(
            Parameter(*str(label).rpartition(".")[::2], unit=str(unit)) for label, unit in entries
        )
    )


def joint_terms(record: Mapping[str, Any] | None) -> JointTerms | None:
    """Joint terms of a record."""
    if record is None:
        return None
    return JointTerms(
        tuple(str(joint) for joint in record["joints"]),
        tuple(str(kind) for kind in record["kinds"]),
        float(record["dead_zone"]),
        float(record["smoothing"]),
    )


def _matrix(terms: Sequence[Mapping[str, Any]], labels: tuple[str, ...]) -> FloatArray:
    matrix = np.zeros((len(terms), len(labels)))
    for row, entry in zip(matrix, terms, strict=True):
        for label, coefficient in entry.items():
            if label not in labels:
                raise ValueError(f"{label} is no standard parameter")
            row[labels.index(label)] = float(coefficient)
    return matrix
