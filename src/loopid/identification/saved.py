"""The file of a fit: all that it takes to use its values, written and read.

It holds which combinations of standard parameters the values are, the options of the force model,
and how the robot was loaded. States with the forces there are in it, too: by these the robot is
known again. Reading never repeats a search for base parameters. A digest shows whether a file was
changed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from hashlib import sha256
from importlib.metadata import version
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError

from loopid.arguments import LARGEST, FloatArray, Number, finite, frozen
from loopid.base_parameters.base import BaseParameters, expression
from loopid.base_parameters.choice import SearchResult
from loopid.base_parameters.structure import Structure, analyse
from loopid.border import refusal
from loopid.errors import DataError, FileError, OptionError
from loopid.files import why_no_file
from loopid.identification.estimates import Estimates
from loopid.identification.force_models import ForceModel
from loopid.identification.quality import (
    FileDeviation,
    MotorUse,
    NoiseModel,
    Quality,
    Robustness,
    StandardUncertainty,
    TermDeviations,
)
from loopid.kinematics.constraint import constraint_residual
from loopid.kinematics.sampling import random_configurations
from loopid.loading.closure import Closure, Coupling
from loopid.loading.files import bundled_directory, own_files
from loopid.parameters import Parameter, ParameterSet
from loopid.regressors.joint_terms import JointTerms
from loopid.regressors.motion_regressors import motion_parameters
from loopid.regressors.structural import structural_observation
from loopid.robot.robot import Robot

ENDINGS = (".yaml", ".yml", ".json")
LARGEST_JSON = 20_000_000  # bytes: a line a number
VERSION: Final = 3  # of the form: another one is refused
STATES = 3  # of the robot, by which it is known again
# Relative difference of closures, forces and columns of one robot; of base parameters from those of
# the standard parameters.
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


class _Options(_Section):
    """Arguments of ``load`` beside the path."""

    closures: tuple[Closure | Coupling, ...] = ()
    motors: tuple[str, ...] | None = None
    reference: dict[str, float | list[float]] | None = None
    lock: tuple[str, ...] = ()
    floating_base: bool = False
    free_mimics: bool = False
    tied: bool = False
    rounding: float | None = None
    xacro: dict[str, str] = Field(default={})


class _Robot(_Section):
    """Name, path then, SHA-256 of the files, how they were loaded, coordinates."""

    name: str
    path: str = ""
    files: dict[str, str]
    options: _Options
    coordinates: tuple[str, ...] = Field(min_length=1)


class _Model(_Section):
    """Options of the force model; forces are along the coordinates named by its rows."""

    model: Literal["gravity", "full"]
    rows: tuple[str, ...] = Field(min_length=1)
    gravity: tuple[float, float, float]
    joint_terms: JointTerms | None = None


class _Standard(_Section):
    """A standard parameter or joint term, with its value where the fit has bodies."""

    name: str
    unit: str
    value: Finite | None = None
    standard_error: Number | None = None
    determined: bool | None = None  # by the data, not by the robot file alone


class _Base(_Section):
    """A base parameter: coefficients of standard parameters, 1 of the first, which leads it."""

    name: str
    unit: str
    expression: str
    value: Finite
    standard_error: Number
    relative_std_percent: Number
    interval_95_percent: tuple[Number, Number]
    terms: dict[str, Finite]


class _States(_Section):
    """Some states of the robot, and the forces that the values give there."""

    configurations: Array  # (STATES, nq)
    velocities: Array  # (STATES, dof)
    accelerations: Array
    forces: Array


class _Uncertainty(_Section):
    """``StandardUncertainty`` without its names."""

    gain: Array
    beside: Array
    file: Infinite
    degrees_of_freedom: Infinite


class _Estimate(_Section):
    """What a ``Fit`` has beside values, covariance and standard parameters."""

    estimator: str
    actuators: tuple[str, ...]
    condition_number: Number
    degrees_of_freedom: Column
    quality: Quality
    weights: Array
    assumed: tuple[str, ...]
    noise: NoiseModel | None = None
    robustness: Robustness | None = None
    uncertainty: _Uncertainty | None = None
    deviation: FileDeviation | None = None
    cutoff: Annotated[float, Field(gt=0, le=LARGEST)] | None = None
    term_deviations: TermDeviations | None = None
    use: MotorUse | None = None
    settled: bool = True
    mistakes: tuple[str, ...] = ()
    unseen_rms: Column | None = None
    broken: tuple[str, ...] = ()


class FitFile(_Section):
    """What the file of a fit says; ``load_fit`` makes the ``Fit`` of it."""

    format: Literal["loopid fit"] = "loopid fit"
    version: Literal[3] = VERSION
    loopid: str
    robot: _Robot  # what the fit is of
    force_model: _Model
    # All p standard parameters and joint terms, and the r base parameters
    standard_parameters: tuple[_Standard, ...] = Field(min_length=1)
    base_parameters: tuple[_Base, ...] = Field(min_length=1)
    covariance: Array  # (r, r)
    check: _States
    estimate: _Estimate  # all else that is known of the values
    # SHA-256 of all but names and paths of the robot; None before it is written
    digest: str | None = None

    @classmethod
    def of(cls, fit: Estimates) -> FitFile:
        """What is written of a fit, which knows its model."""
        model = fit.require_model()
        _require_own_bodies(fit, model)
        robot, base, bodies = model.robot, model.base, fit.standard_parameters
        values = [None] * len(base.parameters) if bodies is None else bodies.tolist()
        return cls.model_validate(
            {
                "loopid": version("loopid"),
                "robot": {
                    "name": robot.name,
                    "path": _place(robot),
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
                "standard_parameters": tuple(fit.standard.values())
                or tuple(
                    {"name": parameter.label, "unit": parameter.unit, "value": value}
                    for parameter, value in zip(base.parameters, values, strict=True)
                ),
                "base_parameters": tuple(
                    {
                        **{"name": x.name, "unit": x.unit, "value": x.value},
                        **{"expression": expression(terms), "terms": dict(terms)},
                        "standard_error": x.standard_error,
                        "relative_std_percent": x.relative_std,
                        "interval_95_percent": x.interval,
                    }
                    for x, terms in zip(fit.estimates, base.terms, strict=True)
                ),
                "covariance": fit.covariance,
                "check": _states(model, fit.values),
                "estimate": fit,
            }
        )

    @classmethod
    def read(cls, path: str | Path) -> FitFile:
        """Read a file; see ``load_fit`` for what is refused."""
        document = _document(Path(path))
        try:
            found, record = cls.model_validate_json(document), json.loads(document)
        except ValidationError as error:
            for detail in error.errors(include_url=False):
                if detail["loc"] == ("version",) and detail["type"] == "literal_error":
                    raise DataError(
                        f"{path} is a fit in form {detail['input']!r:.60}, and this loopid reads "
                        f"form {VERSION}: identify the log again and save the fit",
                        field="version",
                    ) from error
            raise refusal(error, where=f"{path} is not a saved fit", kind=DataError) from error
        except (TypeError, OverflowError) as error:  # of whole numbers that are none
            raise DataError(f"{path} is not a saved fit: {error}") from error
        if found.digest != digest(record):
            raise DataError(
                f"{path} was changed after it was written: its digest is not that of its content, "
                "so write it anew by fit.save",
                field="digest",
            )
        return found

    def record(self) -> dict[str, Any]:
        """All of it in plain numbers, lists and texts, as it stands in the file."""
        record: dict[str, Any] = _plain(self.model_dump(exclude={"digest"}))
        return record | {"digest": digest(record)}

    # What it is made into.

    @property
    def estimates(self) -> dict[str, Any]:
        """What a ``Fit`` is made of but its force model, the same to the bit."""
        standard = np.array([each.value for each in self.standard_parameters], dtype=np.float64)
        estimate = dict(self.estimate)
        if (known := self.estimate.uncertainty) is not None:
            estimate["uncertainty"] = StandardUncertainty(self.standard, **dict(known))
        return {
            **estimate,
            "parameters": self.parameters,
            "values": np.array([base.value for base in self.base_parameters]),
            "covariance": self.covariance,
            "standard_parameters": None if np.isnan(standard).any() else standard,
        }

    @property
    def standard(self) -> ParameterSet:
        """Names of all p standard parameters and joint terms."""
        return ParameterSet(
            tuple(
                replace(Parameter.parse(each.name), unit=each.unit)
                for each in self.standard_parameters
            )
        )

    @property
    def matrix(self) -> FloatArray:
        """M (r, p) of Φ_base = M Φ."""
        labels = self.standard.labels
        return np.array(
            [[x.terms.get(label, 0.0) for label in labels] for x in self.base_parameters]
        )

    @property
    def parameters(self) -> ParameterSet:
        """The r base parameters, each with its sum."""
        found = []
        for base in self.base_parameters:
            leading, *others = base.terms
            own = replace(Parameter.parse(leading), unit=base.unit, others=tuple(others))
            found.append(replace(own, expression=base.expression))
        return ParameterSet(tuple(found))

    def load_robot(self, file: str | Path | None = None) -> Robot:
        """The robot, loaded as it was then: from a file, or from where it was."""
        own = self.robot
        if file is None and not own.path:
            raise FileError(
                f"the robot of the fit, {own.name}, was made in Python: make it again, for "
                "load_fit(path, robot=...)",
                robot=own.name,
            )
        from loopid.loading.robot_files import load  # readers, which fits made in Python do without

        try:
            return load(own.path if file is None else file, **dict(own.options))
        except FileError:
            if file is not None:
                raise
            raise FileError(
                f"the robot of the fit, {own.name}, is no longer at {own.path}: say where it is, "
                'robot="FILE"',
                file=own.path,
            ) from None

    def model_of(self, robot: Robot) -> ForceModel:
        """The force model of a robot with the base parameters of the file: nothing is searched.

        A DataError names the first thing in which it is another robot: names of coordinates, rows
        or parameters, gravity, loops that do not close at the states, forces there, or
        coefficients. Inertials may differ, as in robot files that were exported.
        """
        difference = next(_differences(self, robot), None)
        if difference is None:
            kind, terms = self.force_model.model, self.force_model.joint_terms
            observation = structural_observation(robot, kind, joint_terms=terms)
            model = ForceModel(robot, kind, terms, self._base(analyse(observation)))
            difference = next(_other_numbers(self, model, observation.factor), None)
        if difference is None:
            return model
        hashes = _hashes(robot).items()
        other = [name for name, hashed in hashes if self.robot.files.get(name) != hashed]
        files = f" ({', '.join(other)}: not the files of the fit)" if other else ""
        raise DataError(
            f"this is a fit of {self.robot.name}, not of {robot.source}{files}: {difference}"
        )

    def _base(self, structure: Structure) -> BaseParameters:
        """The base parameters of the file, for what a robot lets be known."""
        labels, M = self.standard.labels, self.matrix
        base = np.array([labels.index(next(iter(each.terms))) for each in self.base_parameters])
        dependent = np.setdiff1d(structure.columns, base)
        chosen = tuple(np.searchsorted(structure.columns, dependent).tolist())
        return BaseParameters(
            parameters=self.standard,
            structure=structure,
            base=frozen(base, np.int64),
            dependent=frozen(dependent, np.int64),
            regrouping=frozen(M[:, dependent]),
            search=SearchResult("saved", "nullspace", chosen, math.nan, False, 1, 0),
        )


def _require_own_bodies(fit: Estimates, model: ForceModel) -> None:
    """Refuse bodies that make other base parameters than those of the fit."""
    bodies = fit.standard_parameters
    if bodies is None:
        return
    made, size = model.base.values(bodies), np.abs(model.base.matrix) @ np.abs(bodies)
    apart = np.abs(made - fit.values) > FOLLOWS * (size + np.abs(fit.values))
    if apart.any():
        k = int(apart.argmax())
        name = fit.parameters.labels[k]
        raise DataError(
            f"standard parameters of the fit make {name} {made[k]:.6g}, not {fit.values[k]:.6g}",
            parameter=name,
        )


def as_file(record: dict[str, Any]) -> str:
    """The record of a fit as it stands in its file."""
    return json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _document(path: Path) -> bytes | str:
    """The content of a file as JSON, also of a YAML that was written otherwise."""
    ending = require_ending(path)
    if reason := why_no_file(path):
        kind = FileError if reason == "does not exist" else DataError
        raise kind(f"{path} {reason}", file=path)
    with path.open("rb") as stream:
        content = stream.read(LARGEST_JSON + 1)
    if not content.strip():
        raise DataError(f"{path} is not a saved fit: it is empty", file=path)
    if len(content) > LARGEST_JSON:
        raise DataError(f"{path} is longer than the {LARGEST_JSON / 1e6:g} MB that are read")
    if ending != ".json" and not content.startswith(b"{"):
        from loopid.yaml_files import LARGE, load_yaml  # for what another program wrote

        return json.dumps(load_yaml(path, DataError, LARGE), default=str)
    return content


def digest(record: dict[str, Any]) -> str:
    """SHA-256 of a record but for where its robot was, which may move."""
    place = ("name", "path", "files")
    robot = {key: value for key, value in record["robot"].items() if key not in place}
    rest = {key: value for key, value in record.items() if key != "digest"} | {"robot": robot}
    return sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def require_ending(path: str | Path) -> str:
    """The ending of a path, one that files of fits have."""
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise OptionError.unknown(f"ending of {path}", ending, ENDINGS)
    return ending


def _plain(value: Any) -> Any:
    """Without what is None; arrays as lists; what is not finite as None, which files call null."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items() if entry is not None}
    if isinstance(value, np.ndarray):
        return value.tolist() if np.isfinite(value).all() else _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _states(model: ForceModel, values: FloatArray) -> _States:
    """Random states, the same for the same robot, and the forces there."""
    q = random_configurations(model.robot, STATES, seed=0)
    shape = 2, STATES, len(model.robot.independent)
    v, a = np.random.default_rng(0).standard_normal(shape)
    forces = _forces(model, values, q, v, a)
    return _States(configurations=q, velocities=v, accelerations=a, forces=forces)


def _forces(
    model: ForceModel, values: FloatArray, q: FloatArray, v: FloatArray, a: FloatArray
) -> FloatArray:
    W = model.base.regressor(model.standard_regressor(q, v, a))
    return np.asarray(model.loaded(W) @ values)


def _differences(file: FitFile, robot: Robot) -> Iterator[str]:
    """What makes a robot another one, before any model: the next build on the first."""
    kind, terms = file.force_model.model, file.force_model.joint_terms
    known = {*robot.joints, *robot.coordinates}
    missing = set(() if terms is None else terms.joints) - known
    if missing:
        yield f"that has no joint {min(missing)}"
    for what, there, here in (
        ("coordinate", robot.coordinates, file.robot.coordinates),
        ("row", robot.independent, file.force_model.rows),
        ("parameter", motion_parameters(robot, kind, terms).labels, file.standard.labels),
    ):
        for one, other in zip_longest(there, here):
            if one != other:
                yield f"{what} {other or 'none'} is where that has {one or 'none'}"
    gravity = robot.model.gravity.linear.tolist()
    if not np.allclose(gravity, file.force_model.gravity, rtol=SAME_ROBOT):
        yield f"gravity is {gravity} m/s² there, not {list(file.force_model.gravity)}"
    residual = np.abs(constraint_residual(robot, file.check.configurations)).max(
        axis=0, initial=0.0
    )
    most = SAME_ROBOT * robot.length + 2 * robot.closure_residual
    if residual.max(initial=0.0) > most:
        k = int(residual.argmax())
        yield f"closure {robot.row_names[k]} has a residual of {residual[k]:.3g} there"


def _other_numbers(file: FitFile, model: ForceModel, R: FloatArray) -> Iterator[str]:
    """Forces and coefficients of another robot; R is the triangular factor of all columns."""
    fit, at = Estimates(**file.estimates, model=model), file.check
    loaded = fit.require_model()
    found = _forces(loaded, fit.values, at.configurations, at.velocities, at.accelerations)
    apart = np.abs(found - at.forces).max(axis=0)
    k = int(apart.argmax())
    if apart[k] > SAME_ROBOT * np.abs(at.forces).max():
        terms = model.joint_terms
        why = " (bodies that load joints count)" if terms is not None and terms.loaded else ""
        yield f"the force along {file.force_model.rows[k]} differs by {apart[k]:.3g} there{why}"
    M, own, sizes = file.matrix, model.base.base, np.linalg.norm(R, axis=0)
    errors = np.linalg.norm(R - R[:, own] @ M, axis=0)
    allowed = SAME_ROBOT * (sizes + sizes[own] @ np.abs(M)) + NO_EFFECT * sizes.max()
    if (errors > allowed).any():
        worst = file.standard.labels[int(np.argmax(errors / allowed))]
        yield f"{worst} has other coefficients there"


def _place(robot: Robot) -> str:
    """Where a robot is loaded from again: a path, or the name of a bundled robot."""
    if robot.path is None:
        return ""
    name = robot.path.stem
    bundled = robot.path == bundled_directory() / f"{name}.yaml"
    return name if bundled else str(robot.path.absolute())


def _hashes(robot: Robot) -> dict[str, str]:
    """SHA-256 of the files of a robot, by name."""
    return {f.name: sha256(f.read_bytes()).hexdigest() for f in own_files(robot)}
