"""Base parameters as arrays in an NPZ archive, without pickled objects."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from loopid.errors import DataError, MissingFileError, OptionError
from loopid.export.base_yaml import FORMAT, joint_terms, parameter_set
from loopid.files import why_no_file

if TYPE_CHECKING:
    from loopid.export.base_values import BaseValues

Arrays = Mapping[str, NDArray[Any]]


def content(values: BaseValues, _: str | Path) -> bytes:
    """The archive; the same bytes for the same values."""
    stream = BytesIO()
    np.savez(stream, **_arrays(values))
    return stream.getvalue()


def _arrays(values: BaseValues) -> dict[str, Any]:
    """What is in the archive, by name; docs/exports.md lists it."""
    terms = values.joint_terms
    arrays = {
        "format": np.array(FORMAT),
        "robot": np.array(values.robot),
        "model": np.array(values.model),
        "loopid": np.array(values.version),
        "rows": _texts(values.rows),
        "names": _texts(values.names),
        "units": _texts(values.units),
        "expressions": _texts(values.expressions),
        "values": values.values,
        "matrix": values.matrix,
        "standard_names": _texts(values.standard.labels),
        "standard_units": _texts(parameter.unit for parameter in values.standard),
    }
    if values.covariance is not None:
        arrays["covariance"] = values.covariance
    if terms is not None:
        arrays["joint_term_joints"] = _texts(terms.joints)
        arrays["joint_term_kinds"] = _texts(terms.kinds)
        arrays["joint_term_rates"] = np.array([terms.dead_zone, terms.smoothing])
    return arrays


def _texts(texts: Any) -> NDArray[np.str_]:
    return np.array(list(texts), dtype=np.str_)


def fields(path: str | Path) -> dict[str, Any]:
    """Fields of what a file holds.

    Raises
    ------
    MissingFileError, DataError
    """
    reason = why_no_file(Path(path))
    if reason:
        raise MissingFileError(f"{path} {reason}")
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, AttributeError, BadZipFile) as error:
        raise DataError(f"{path} is no NPZ archive: {error}") from error
    if str(arrays.get("format")) != FORMAT:
        raise DataError(f"{path} holds no base parameters: its format is not {FORMAT!r}")
    try:
        return _fields(arrays)
    except KeyError as error:
        raise DataError(f"{path} holds no base parameters: {error} is missing") from error
    except (TypeError, ValueError, IndexError, OptionError) as error:
        raise DataError(f"{path} holds no base parameters: {error}") from error


def _fields(arrays: Arrays) -> dict[str, Any]:
    standard = zip(
        _listed(arrays, "standard_names"), _listed(arrays, "standard_units"), strict=True
    )
    terms = None
    if "joint_term_joints" in arrays:
        dead_zone, smoothing = arrays["joint_term_rates"].tolist()
        terms = {
            "joints": _listed(arrays, "joint_term_joints"),
            "kinds": _listed(arrays, "joint_term_kinds"),
            "dead_zone": dead_zone,
            "smoothing": smoothing,
        }
    return {
        "robot": str(arrays["robot"]),
        "model": str(arrays["model"]),
        "version": str(arrays["loopid"]),
        "rows": tuple(_listed(arrays, "rows")),
        "joint_terms": joint_terms(terms),
        "standard": parameter_set(standard),
        "names": tuple(_listed(arrays, "names")),
        "matrix": arrays["matrix"],
        "values": arrays["values"],
        "covariance": arrays.get("covariance"),
    }


def _listed(arrays: Arrays, name: str) -> list[str]:
    return [str(text) for text in arrays[name].tolist()]
