"""Saved fits: one schema for everything that is identified and written to a file.

A file holds all that it takes to use its values: which combinations of standard parameters they
are, the options of the force model, how the robot was loaded, and states with the forces there, by
which the robot is known again. Reading one never repeats a search for base parameters.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from hashlib import sha256
from importlib.metadata import version
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError

from loopid.arguments import LARGEST, FloatArray, Number, checked, finite, frozen
from loopid.base_parameters.base import BaseParameters, expression
from loopid.base_parameters.choice import SearchResult
from loopid.base_parameters.structure import analyse
from loopid.border import refusal
from loopid.errors import DataError, FileError, OptionError
from loopid.files import require_other_file, why_no_file, write_file
from loopid.identification.force_model import ForceModel
from loopid.identification.plausibility import require_sane
from loopid.identification.result import (
    FileDeviation,
    FitResult,
    MotorUse,
    NoiseModel,
    Quality,
    RobotUncertainty,
    Robustness,
    TermDeviations,
)
from loopid.kinematics.constraint import constraint_residual
from loopid.kinematics.projection import closed_motion
from loopid.kinematics.sampling import random_configurations
from loopid.loading.closure import Closure, Coupling
from loopid.loading.files import bundled_robots, files_of
from loopid.loading.load import load_mechanism
from loopid.parameters import KINDS, Parameter, ParameterSet
from loopid.regressors.joint_terms import JointTerms, load_places, with_loads
from loopid.regressors.motion_regressors import motion_parameters, motion_regressor
from loopid.regressors.structural import structural_observation
from loopid.robot.mechanism import Mechanism
from loopid.yaml_files import LARGE, load_yaml

ENDINGS = (".yaml", ".yml", ".json")
LARGEST_JSON = 5 * LARGE  # bytes: a line a number
STATES = 3  # of the robot, by which it is known again
# Relative difference of closures, forces and columns up to which a robot is the same; of base
# parameters from those of the standard parameters.
SAME_ROBOT, FOLLOWS = 1e-6, 1e-9
NO_EFFECT = 1e-10  # of a column, relative to the largest

Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Array = Annotated[FloatArray, PlainValidator(lambda given: frozen(finite(given, "numbers")))]
Infinite = Annotated[  # where null
    FloatArray,
    PlainValidator(lambda given: frozen([math.inf if x is None else x for x in given])),
]
Column = Annotated[FloatArray, PlainValidator(lambda given: frozen(given))]  # NaN where null


class _Section(BaseModel):
    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        from_attributes=True,
        arbitrary_types_allowed=True,  # arrays: lists in the file
        defer_build=True,  # by the first use: importing loopid does not wait for it
    )


class SavedOptions(_Section):
    """Arguments of ``load_mechanism`` beside the path."""

    closures: tuple[Closure | Coupling, ...] = ()
    motors: tuple[str, ...] | None = None
    reference: dict[str, float | list[float]] | None = None
    lock: tuple[str, ...] = ()
    floating_base: bool = False
    free_mimics: bool = False
    tied: bool = False
    rounding: float | None = None
    xacro: dict[str, str] = Field(default={})


class SavedRobot(_Section):
    """The robot: name, path then, SHA-256 of its files, how they were loaded, its coordinates."""

    name: str
    path: str = ""
    files: dict[str, str]
    options: SavedOptions
    coordinates: tuple[str, ...] = Field(min_length=1)


class SavedForceModel(_Section):
    """The options of the force model; forces are along the coordinates named by its rows."""

    model: Literal["gravity", "full"]
    rows: tuple[str, ...] = Field(min_length=1)
    gravity: tuple[float, float, float]
    joint_terms: JointTerms | None = None


class SavedStandard(_Section):
    """A standard parameter or joint term, with its value where the fit has bodies.

    ``told`` is whether the data tell it, or only the robot file.
    """

    name: str
    unit: str
    value: Finite | None = None
    standard_error: Number | None = None
    told: bool | None = None


class SavedBase(_Section):
    """A base parameter: coefficients of standard parameters, 1 of the first, which leads it.

    The name of a combination is ``<leading parameter> + 3 more``.
    """

    name: str
    unit: str
    expression: str
    value: Finite
    standard_error: Number = math.nan
    relative_std_percent: Number = math.nan
    interval_95_percent: tuple[Number, Number] = (math.nan, math.nan)
    terms: dict[str, Finite]


class SavedState(_Section):
    """A state of the robot, and the forces that the values give there."""

    configuration: Array
    velocity: Array
    acceleration: Array
    force: Array


class SavedUncertainty(_Section):
    """``RobotUncertainty`` of the standard parameters."""

    gain: Array
    beside: Array
    file: Infinite
    degrees_of_freedom: Infinite


class SavedEstimate(_Section):
    """What a ``FitResult`` has beside values, covariance and standard parameters."""

    estimator: str
    actuators: tuple[str, ...]
    condition_number: Number
    degrees_of_freedom: Column
    quality: Quality
    weights: Array
    assumed: tuple[str, ...]
    noise: NoiseModel | None = None
    robustness: Robustness | None = None
    uncertainty: SavedUncertainty | None = None
    deviation: FileDeviation | None = None
    cutoff: Annotated[float, Field(gt=0, le=LARGEST)] | None = None
    term_deviations: TermDeviations | None = None
    use: MotorUse | None = None
    mistakes: tuple[str, ...] = ()
    unseen_rms: Column | None = None
    broken: tuple[str, ...] = ()


class SavedFit(_Section):
    """Values of base parameters with all that it takes to use them; from ``read_fit``.

    Attributes
    ----------
    robot : SavedRobot
    force_model : SavedForceModel
    standard_parameters : tuple of SavedStandard
        All p standard parameters and joint terms.
    base_parameters : tuple of SavedBase
        The r base parameters.
    covariance : FloatArray or None
        (r, r).
    check : tuple of SavedState
    estimate : SavedEstimate or None
        Where a ``FitResult`` was saved.
    digest : str or None
        SHA-256 of all but names and paths of the robot, by which a changed file is known; None
        before it is written.
    """

    format: Literal["loopid fit"] = "loopid fit"
    version: Literal[1] = 1
    loopid: str
    robot: SavedRobot
    force_model: SavedForceModel
    standard_parameters: tuple[SavedStandard, ...] = Field(min_length=1)
    base_parameters: tuple[SavedBase, ...] = Field(min_length=1)
    covariance: Array | None = None
    check: tuple[SavedState, ...] = Field(min_length=1)
    estimate: SavedEstimate | None = None
    digest: str | None = None

    @classmethod
    def of(cls, model: ForceModel, fit: FitResult | FloatArray) -> SavedFit:
        """What is saved of a fit, or of values (r,), of the parameters of a force model.

        Raises
        ------
        DataError
            When the fit is not one of these parameters, or has standard parameters of others.
        """
        estimate = fit if isinstance(fit, FitResult) else None
        model = model if estimate is None else model_of(estimate, model)
        robot, base, values = model.mechanism, model.base, _values_of(model, fit)
        bodies = None if estimate is None else estimate.standard_parameters
        standard = [None] * len(base.parameters) if bodies is None else bodies.tolist()
        rows = () if estimate is None else estimate.robot.values()
        known = [{"standard_error": x.standard_error, "told": x.told} for x in rows]
        return cls.model_validate(
            {
                "loopid": version("loopid"),
                "robot": {
                    "name": robot.name,
                    "path": "" if robot.path is None else str(robot.path),
                    "files": _hashes(robot),
                    "options": dict(robot.options),
                    "coordinates": robot.coordinates,
                },
                "force_model": {
                    "model": model.model,
                    "rows": robot.independent,
                    "gravity": tuple(robot.model.gravity.linear.tolist()),
                    "joint_terms": model.joint_terms,
                },
                "standard_parameters": tuple(
                    {"name": parameter.label, "unit": parameter.unit, "value": value, **more}
                    for parameter, value, more in zip(
                        base.parameters, standard, known or [{}] * len(standard), strict=True
                    )
                ),
                "base_parameters": tuple(_entries(model, values, estimate)),
                "covariance": estimate and estimate.covariance,
                "check": tuple(_states(model.with_loads(values, bodies), values)),
                "estimate": estimate,
            }
        )

    def __repr__(self) -> str:
        kind = "values" if self.estimate is None else self.estimate.estimator
        return (
            f"<SavedFit of {self.robot.name}: {len(self.base_parameters)} base parameters, "
            f"{self.force_model.model} model, {kind}>"
        )

    __str__ = __repr__

    @property
    def standard(self) -> ParameterSet:
        """Names of all p standard parameters and joint terms."""
        return _parameter_set(self.standard_parameters)

    @property
    def standard_values(self) -> FloatArray:
        """Values (p,) of the standard parameters; NaN where the file gives none."""
        return np.array([standard.value for standard in self.standard_parameters], dtype=np.float64)

    @property
    def parameters(self) -> ParameterSet:
        """The r base parameters, each with its sum."""
        found = []
        for base in self.base_parameters:
            leading, *others = base.terms
            found.append(
                replace(
                    Parameter.parse(leading),
                    unit=base.unit,
                    others=tuple(others),
                    expression=base.expression,
                )
            )
        return ParameterSet(tuple(found))

    @property
    def values(self) -> FloatArray:
        """Base parameters (r,)."""
        return np.array([base.value for base in self.base_parameters])

    @property
    def matrix(self) -> FloatArray:
        """M (r, p) of Φ_base = M Φ."""
        rows = [
            [base.terms.get(label, 0.0) for label in self.standard.labels]
            for base in self.base_parameters
        ]
        return np.array(rows)

    @property
    def cutoff(self) -> float | None:
        """In Hz, of the filter, where it was chosen by predictions."""
        return None if self.estimate is None else self.estimate.cutoff

    @property
    def result(self) -> FitResult | None:
        """The fit as it was saved; None where only values were."""
        if self.estimate is None or self.covariance is None:
            return None
        standard, estimate = self.standard_values, dict(self.estimate)
        if (known := self.estimate.uncertainty) is not None:
            estimate["uncertainty"] = RobotUncertainty(self.standard, **dict(known))
        return FitResult(
            parameters=self.parameters,
            values=self.values,
            covariance=self.covariance,
            standard_parameters=None if np.isnan(standard).any() else standard,
            **estimate,
        )

    def load_robot(self, file: str | Path | None = None) -> Mechanism:
        """The robot of the fit, loaded as it was then: from a file, or from where it was.

        Raises
        ------
        FileError
            When it is no longer there.
        """
        options, own = dict(self.robot.options), self.robot
        if file is not None:
            return load_mechanism(file, **options)
        if not own.path:
            raise FileError(
                f"the robot of the fit, {own.name}, was made in Python: make it again, for "
                "saved.find_force_model(robot)",
                robot=own.name,
            )
        try:
            return load_mechanism(own.path, **options)
        except FileError:
            if own.name in bundled_robots():
                return load_mechanism(own.name, **options)
            raise FileError(
                f"the robot of the fit, {own.name}, is no longer at {own.path}: say where it is, "
                'file="FILE"',
                file=own.path,
            ) from None

    @checked
    def require(self, mechanism: Mechanism) -> None:
        """Refuse a mechanism on which the values would give other forces.

        Names of coordinates, rows and parameters must agree, and gravity; the states of the fit
        must close the loops, and give the forces of the file, to ``SAME_ROBOT``. Inertials may
        differ, as in robot files that were exported.

        Raises
        ------
        DataError
            Naming both robots, and the first thing that differs.
        """
        difference = next(_differences(self, mechanism), None)
        if difference is not None:
            raise self._refusal(mechanism, difference)

    @property
    def _leading(self) -> list[int]:
        labels = self.standard.labels
        return [labels.index(next(iter(base.terms))) for base in self.base_parameters]

    @checked
    def find_force_model(self, mechanism: Mechanism) -> ForceModel:
        """The force model of a mechanism with the base parameters of the file.

        Nothing is searched: the combinations are those of the file, checked against the structural
        observation of the mechanism.

        Raises
        ------
        DataError
            When the mechanism is another one.
        """
        self.require(mechanism)
        kind, terms = self.force_model.model, self.force_model.joint_terms
        observation = structural_observation(mechanism, kind, joint_terms=terms)
        structure, M, base = analyse(observation), self.matrix, np.array(self._leading)
        R, sizes = observation.factor, np.linalg.norm(observation.factor, axis=0)
        errors = np.linalg.norm(R - R[:, base] @ M, axis=0)
        allowed = SAME_ROBOT * (sizes + sizes[base] @ np.abs(M)) + NO_EFFECT * sizes.max()
        if (errors > allowed).any():
            worst = self.standard.labels[int(np.argmax(errors / allowed))]
            raise self._refusal(mechanism, f"{worst} has other coefficients there")
        dependent = np.setdiff1d(structure.columns, base)
        chosen = tuple(np.searchsorted(structure.columns, dependent).tolist())
        found = BaseParameters(
            parameters=self.standard,
            structure=structure,
            base=frozen(base, np.int64),
            dependent=frozen(dependent, np.int64),
            regrouping=frozen(M[:, dependent]),
            search=SearchResult("saved", "nullspace", chosen, math.nan, False, 1, 0),
        )
        standard = self.standard_values
        known = None if np.isnan(standard).any() else standard
        return ForceModel(mechanism, kind, terms, found).with_loads(self.values, known)

    def model_for(self, robot: Mechanism | ForceModel, *, anyway: bool = False) -> ForceModel:
        """As ``find_force_model``, of a fit that keeps the laws of sane ones: for ``Dynamics``."""
        self.require_sane(anyway=anyway)
        return self.find_force_model(robot if isinstance(robot, Mechanism) else robot.mechanism)

    def require_bodies(self) -> FloatArray:
        """Standard parameters and joint terms (p,), which a robot file can be made of.

        Raises
        ------
        DataError
            When the fit is of base parameters only.
        """
        values = self.standard_values
        if np.isnan(values).any():
            kind = "values" if self.estimate is None else self.estimate.estimator
            raise DataError(
                f"a fit by {kind} has base parameters, which are those of many bodies: identify "
                "with the default estimator, and save the recommended fit, which has bodies"
            )
        return values

    def record(self) -> dict[str, Any]:
        """All of it in plain numbers, lists and texts, as it stands in the file."""
        record: dict[str, Any] = _plain(self.model_dump(exclude={"digest"}))
        return record | {"digest": _digest(record)}

    def require_sane(self, *, anyway: bool = False) -> None:
        """Refuse a fit that breaks a law of sane ones (``absurdities``), unless asked for anyway.

        Raises
        ------
        OptionError
        """
        require_sane(self.result, self.force_model.joint_terms, anyway)

    def content(self, path: str | Path, *, anyway: bool = False) -> str:
        """The content of a file of that name: JSON, which is YAML, but read 16 times faster.

        Refused as by ``require_sane``.
        """
        _ending(path)
        self.require_sane(anyway=anyway)
        return json.dumps(self.record(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"

    def save(self, path: str | Path, *, anyway: bool = False) -> Path:
        """Write to a file, whole or not at all; see ``save_fit``."""
        write_file(path, self.content(path, anyway=anyway))
        return Path(path)

    def _refusal(self, mechanism: Mechanism, difference: str) -> DataError:
        hashes = _hashes(mechanism).items()
        other = [name for name, hashed in hashes if self.robot.files.get(name) != hashed]
        files = f" ({', '.join(other)}: not the files of the fit)" if other else ""
        return DataError(
            f"this is a fit of {self.robot.name}, not of {mechanism.source}{files}: {difference}"
        )


def model_of(fit: FitResult, model: ForceModel) -> ForceModel:
    """The force model, or the one that ``identify`` made of it where it chose joint terms."""
    own = fit.force_model
    if own is None or fit.parameters == model.parameters or own.mechanism != model.mechanism:
        return model
    return own.with_loads(fit.values, fit.standard_parameters)


def _values_of(model: ForceModel, fit: FitResult | FloatArray) -> FloatArray:
    """Base parameters (r,) of a fit, which must be those of the force model."""
    fitted = model.parameters
    if isinstance(fit, FitResult):
        fitted, values = fit.parameters, fit.values
    else:
        values = finite(fit, "values")
    if fitted != model.parameters or values.shape != (len(model.base),):
        raise DataError(
            f"a fit of {len(fitted)} parameters with values {values.shape} is none of the "
            f"{len(model.base)} base parameters of the force model"
        )
    bodies = fit.standard_parameters if isinstance(fit, FitResult) else None
    if bodies is not None:
        made, size = model.base.values(bodies), np.abs(model.base.matrix) @ np.abs(bodies)
        apart = np.abs(made - values) > FOLLOWS * (size + np.abs(values))
        if apart.any():
            k = int(apart.argmax())
            name = fitted.labels[k]
            raise DataError(
                f"standard parameters of the fit make {name} {made[k]:.6g}, not {values[k]:.6g}",
                parameter=name,
            )
    return values


def _entries(
    model: ForceModel, values: FloatArray, fit: FitResult | None
) -> Iterator[dict[str, Any]]:
    """An entry for each base parameter, with its uncertainty where there is a fit."""
    columns = zip(model.parameters, model.base.terms, values.tolist(), strict=True)
    estimates = fit.estimates if fit is not None else ()
    for k, (parameter, terms, value) in enumerate(columns):
        entry = {"name": parameter.name, "unit": parameter.unit, "value": value}
        entry |= {"expression": expression(terms), "terms": dict(terms)}
        for estimate in estimates[k : k + 1]:
            entry["standard_error"] = estimate.standard_error
            entry["relative_std_percent"] = estimate.relative_std
            entry["interval_95_percent"] = estimate.interval
        yield entry


def _states(model: ForceModel, values: FloatArray) -> Iterator[dict[str, FloatArray]]:
    """Random states, the same for the same robot, and the forces there."""
    q = random_configurations(model.mechanism, STATES, seed=0)
    shape = 2, STATES, len(model.mechanism.independent)
    v, a = np.random.default_rng(0).standard_normal(shape)
    W = model.base.regressor(model.standard_regressor(q, v, a))
    force = model.loaded(W) @ values
    for state in zip(q, v, a, force, strict=True):
        yield dict(zip(SavedState.model_fields, state, strict=True))


@checked
def save_fit(
    path: str | Path, model: ForceModel, fit: FitResult | FloatArray, *, anyway: bool = False
) -> Path:
    """Save a fit with all that it takes to use it: for ``read_fit`` and ``loopid export``.

    Parameters
    ----------
    path : path
        Ending in .yaml, .yml or .json; written whole or not at all.
    model : ForceModel
        Whose parameters were fitted, or that ``identify`` was given.
    fit : FitResult or FloatArray
        Or values (r,) of the base parameters.
    anyway : bool
        Whether a fit that breaks a law of sane ones (``absurdities``) is written.

    Raises
    ------
    DataError
        When the fit is not one of the parameters of the force model.
    OptionError
        When the name ends otherwise, or the fit breaks a law.
    FileError
        When the file cannot be written, or is one of the robot's.

    Examples
    --------
    >>> import loopid, tempfile
    >>> model = loopid.find_force_model(loopid.load_mechanism("five_bar"), joint_terms=None)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     loopid.save_fit(f"{folder}/fit.json", model, model.prior).name
    'fit.json'
    """
    require_other_file(path, *robot_files(model.mechanism))
    return SavedFit.of(model, fit).save(path, anyway=anyway)


@checked
def read_fit(path: str | Path) -> SavedFit:
    """Read a fit that ``save_fit`` wrote, the same to the bit.

    Raises
    ------
    FileError
        When there is no such file.
    DataError
        When it is no saved fit, or damaged: what is missing or makes no sense.
    OptionError
        When the name ends otherwise than .yaml, .yml or .json.

    Examples
    --------
    >>> import loopid, tempfile
    >>> robot = loopid.load_mechanism("five_bar")
    >>> model = loopid.find_force_model(robot, joint_terms=None)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = loopid.save_fit(f"{folder}/fit.yaml", model, 1.1 * model.prior)
    ...     saved = loopid.read_fit(path)
    >>> saved
    <SavedFit of five_bar: 6 base parameters, gravity model, values>
    >>> saved.find_force_model(robot).parameters == model.parameters
    True
    """
    document = _document(Path(path))
    try:
        saved = SavedFit.model_validate_json(document)
    except ValidationError as error:
        raise refusal(error, where=f"{path} is not a saved fit", kind=DataError) from error
    except (TypeError, OverflowError) as error:  # of whole numbers that are none
        raise DataError(f"{path} is not a saved fit: {error}") from error
    if saved.digest != _digest(json.loads(document)):
        raise DataError(
            f"{path} was changed after it was written: its digest is not that of its content, so "
            "write it anew by save_fit",
            field="digest",
        )
    return saved


def _document(path: Path) -> bytes | str:
    """The content of a file as JSON, also of a YAML that was written otherwise."""
    ending = _ending(path)
    if reason := why_no_file(path):
        kind = FileError if reason == "does not exist" else DataError
        raise kind(f"{path} {reason}", file=path)
    with path.open("rb") as stream:
        content = stream.read(LARGEST_JSON + 1)
    if len(content) > LARGEST_JSON:
        raise DataError(f"{path} is longer than the {LARGEST_JSON / 1e6:g} MB that are read")
    if ending != ".json" and not content.startswith(b"{"):
        return json.dumps(load_yaml(path, DataError, LARGE), default=str)
    return content


def _digest(record: dict[str, Any]) -> str:
    """SHA-256 of a record but for where its robot was, which may move."""
    place = ("name", "path", "files")
    robot = {key: value for key, value in record["robot"].items() if key not in place}
    rest = {key: value for key, value in record.items() if key != "digest"} | {"robot": robot}
    return sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _ending(path: str | Path) -> str:
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise OptionError.unknown(f"ending of {path}", ending, ENDINGS)
    return ending


def _plain(value: Any) -> Any:
    """Without what is None; arrays as lists; what is not finite as None, which files call null."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items() if entry is not None}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _parameter_set(entries: Iterable[SavedStandard | SavedBase]) -> ParameterSet:
    return ParameterSet(
        tuple(replace(Parameter.parse(entry.name), unit=entry.unit) for entry in entries)
    )


def _differences(saved: SavedFit, mechanism: Mechanism) -> Iterator[str]:
    """What makes a mechanism another robot: only the first counts, the next build on it."""
    kind, terms = saved.force_model.model, saved.force_model.joint_terms
    known = {*mechanism.joints, *mechanism.coordinates}
    missing = set(() if terms is None else terms.joints) - known
    if missing:
        yield f"that has no joint {min(missing)}"
    for what, there, here in (
        ("coordinate", mechanism.coordinates, saved.robot.coordinates),
        ("row", mechanism.independent, saved.force_model.rows),
        ("parameter", motion_parameters(mechanism, kind, terms).labels, saved.standard.labels),
    ):
        for one, other in zip_longest(there, here):
            if one != other:
                yield f"{what} {other or 'none'} is where that has {one or 'none'}"
    gravity = mechanism.model.gravity.linear.tolist()
    if not np.allclose(gravity, saved.force_model.gravity, rtol=SAME_ROBOT):
        yield f"gravity is {gravity} m/s² there, not {list(saved.force_model.gravity)}"
    q, v, a, force = (
        np.array([getattr(state, part) for state in saved.check])
        for part in ("configuration", "velocity", "acceleration", "force")
    )
    residual = np.abs(constraint_residual(mechanism, q)).max(axis=0, initial=0.0)
    most = SAME_ROBOT * mechanism.length + 2 * mechanism.closure_residual
    if residual.max(initial=0.0) > most:
        k = int(residual.argmax())
        yield f"closure {mechanism.row_names[k]} has a residual of {residual[k]:.3g} there"
    W = motion_regressor(mechanism, closed_motion(mechanism, q, v, a), kind, joint_terms=terms)
    values, places = saved.values, load_places(saved.parameters, mechanism.independent)
    K, standard = W[..., saved._leading], saved.standard_values
    own = np.array([each.kind in KINDS for each in saved.parameters])
    bodies = np.array([each.kind in KINDS for each in saved.standard])
    loads = K @ (own * values) if np.isnan(standard).any() else W @ (bodies * standard)
    K = with_loads(K, places, loads)
    apart = np.abs(K @ values - force).max(axis=0)
    k = int(apart.argmax())
    if apart[k] > SAME_ROBOT * np.abs(force).max():
        why = " (bodies that load joints count)" if terms is not None and terms.loaded else ""
        row = saved.force_model.rows[k]
        yield f"the force along {row} differs by {apart[k]:.3g} there{why}"


def _hashes(mechanism: Mechanism) -> dict[str, str]:
    """SHA-256 of the files of a robot, by name."""
    return {f.name: sha256(f.read_bytes()).hexdigest() for f in robot_files(mechanism)}


def robot_files(mechanism: Mechanism) -> tuple[Path, ...]:
    """The file that a mechanism was loaded from, and that of its tree, which may be the same."""
    if mechanism.path is None:
        return ()
    files = files_of(mechanism)
    return files.named, files.tree
