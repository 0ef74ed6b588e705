"""The files that fits are saved to, whichever it is, as one thing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from loopid.arguments import checked, checked_fields
from loopid.arrays import FloatArray
from loopid.consistency import ConsistentFit
from loopid.consistency.record import FORMAT as CONSISTENT_FORMAT
from loopid.errors import DataError
from loopid.export import base_npz, base_yaml
from loopid.export.base_values import BaseValues
from loopid.identification import FitResult
from loopid.identification.record import FORMAT as FIT_FORMAT
from loopid.identification.record import fields_of
from loopid.identification.storage import read_record
from loopid.parameters import GRAVITY_KINDS, KINDS, ParameterSet
from loopid.regressors import JointTerms


@checked_fields
@dataclass(frozen=True)
class SavedFit:
    """What a file says of base parameters.

    Attributes
    ----------
    source : Path
    parameters : ParameterSet
        Leading parameter of each.
    rows : tuple of str
        Independent coordinates, along which forces are.
    values : FloatArray
        (r,).
    covariance : FloatArray or None
        (r, r).
    model : str or None
        ``"gravity"`` or ``"full"``, where the file says so.
    joint_terms : JointTerms or None
        What the file says, or its parameters show: terms that are regrouped into others, as drive
        inertias often are, do not.
    matrix : FloatArray or None
        (r, p), which combinations of standard parameters they are, where the file says so.
    standard : FloatArray or None
        (p,), standard parameters and joint terms, of a consistent fit.
    """

    source: Path
    parameters: ParameterSet
    rows: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray | None
    model: str | None
    joint_terms: JointTerms | None
    matrix: FloatArray | None = None
    standard: FloatArray | None = None


@checked
def read_fit(path: str | Path) -> SavedFit:
    """Read a fit that ``FitResult``, ``ConsistentFit`` or ``BaseValues`` wrote.

    Raises
    ------
    MissingFileError, DataError
        Naming the file.
    """
    place = Path(path)
    if place.suffix.lower() == ".npz":
        return _of_values(place, BaseValues(**base_npz.fields(place)))
    record = read_record(place)
    if record.get("format") == base_yaml.FORMAT:
        return _of_values(place, BaseValues(**base_yaml.fields_of(record, place)))
    if record.get("format") == CONSISTENT_FORMAT:
        return _of_consistent(place, ConsistentFit.load(place))
    if record.get("format") != FIT_FORMAT:
        formats = f"{FIT_FORMAT!r}, {CONSISTENT_FORMAT!r} or {base_yaml.FORMAT!r}"
        raise DataError(f"{path} is no saved fit: its format is none of {formats}")
    return _of_result(place, FitResult(**fields_of(record, place)))


def _of_values(place: Path, values: BaseValues) -> SavedFit:
    units = dict(zip(values.standard.labels, values.standard, strict=True))
    return SavedFit(
        source=place,
        parameters=ParameterSet(tuple(units[name] for name in values.names)),
        rows=values.rows,
        values=values.values,
        covariance=values.covariance,
        model=values.model,
        joint_terms=values.joint_terms,
        matrix=values.matrix,
    )


def _of_result(place: Path, fit: FitResult) -> SavedFit:
    return SavedFit(
        source=place,
        parameters=fit.parameters,
        rows=fit.actuators,
        values=fit.values,
        covariance=fit.covariance,
        model=None,
        joint_terms=_joint_terms(fit.parameters),
    )


def _of_consistent(place: Path, fit: ConsistentFit) -> SavedFit:
    return SavedFit(
        source=place,
        parameters=fit.base_parameters,
        rows=fit.fit_cost.actuators,
        values=fit.values,
        covariance=None,
        model=likely_models(fit.parameters)[0],
        joint_terms=_joint_terms(fit.parameters),
        standard=fit.standard_parameters,
    )


def _joint_terms(parameters: ParameterSet) -> JointTerms | None:
    terms = [parameter for parameter in parameters if parameter.kind not in KINDS]
    joints = tuple(dict.fromkeys(parameter.link for parameter in terms))
    kinds = tuple(dict.fromkeys(parameter.kind for parameter in terms))
    return JointTerms(joints, kinds) if terms else None


def likely_models(parameters: ParameterSet) -> tuple[str, ...]:
    """The models that parameters can be of, the likelier first."""
    shown = {parameter.kind for parameter in parameters} & set(KINDS)
    return ("gravity", "full") if shown <= set(GRAVITY_KINDS) else ("full",)
