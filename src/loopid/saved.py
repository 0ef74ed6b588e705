"""Saved fits: one schema for everything that is identified and written to a file.

A file holds all that it takes to use its values: which combinations of standard parameters they
are, the options of the force model, how the robot was loaded, and states with the forces there, by
which the robot is known again. Reading one never repeats a search for base parameters.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from hashlib import sha256
from html import escape
from importlib.metadata import version
from io import BytesIO, StringIO
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Literal
from zipfile import BadZipFile

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    ValidationError,
    model_validator,
)
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from loopid.arguments import checked
from loopid.arrays import FloatArray, IntArray, finite, frozen
from loopid.base_parameters import BaseParameters, SearchResult, analyse, expression
from loopid.consistency import ConsistentFit, FitCost, consistent_parameters
from loopid.errors import DataError, MissingFileError, OptionError
from loopid.experiment import ForceModel
from loopid.files import why_no_file, write_file
from loopid.identification import Estimate, FitResult, NoiseModel, Quality, Robustness
from loopid.kinematics import closed_motion, constraint_residual, random_configurations
from loopid.loading import find_files
from loopid.parameters import Parameter, ParameterSet
from loopid.regressors import (
    JointTerms,
    motion_parameters,
    motion_regressor,
    structural_observation,
)
from loopid.robot import Mechanism

ENDINGS = (".yaml", ".yml", ".json", ".npz")
STATES = 3  # of the robot, by which it is known again
# Relative difference of closures, forces and columns up to which a robot is the same.
SAME_ROBOT = 1e-6
NO_EFFECT = 1e-10  # of a column, relative to the largest

# Arrays are lists in the file. What is not finite, where it may be, is null.
Array = Annotated[
    FloatArray,
    PlainValidator(lambda given: frozen(finite(given, "numbers"))),
    PlainSerializer(lambda array: array.tolist()),
]
Column = Annotated[
    FloatArray,
    PlainValidator(lambda given: frozen(np.array(given, dtype=np.float64))),
    PlainSerializer(lambda array: np.where(np.isfinite(array), array, None).tolist()),
]
Counts = Annotated[
    IntArray,
    PlainValidator(lambda given: frozen(given, np.int64)),
    PlainSerializer(lambda array: array.tolist()),
]
Number = Annotated[
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(lambda given: math.nan if given is None else given),
    PlainSerializer(lambda number: number if math.isfinite(number) else None),
]


class _Record(BaseModel):
    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        from_attributes=True,
        defer_build=True,  # by the first use: importing loopid does not wait for it
    )


class SavedOptions(_Record):
    """Arguments of ``load_mechanism`` beside the path."""

    lock: tuple[str, ...] = ()
    floating_base: bool = False
    free_mimics: bool = False
    tied: bool = False


class SavedRobot(_Record):
    """The robot: its name, SHA-256 of its files, how they were loaded, names of coordinates."""

    name: str
    files: dict[str, str]
    options: SavedOptions
    coordinates: tuple[str, ...]


class SavedForceModel(_Record):
    """The options of the force model; forces are along the coordinates named by its rows."""

    model: Literal["gravity", "full"]
    rows: tuple[str, ...]
    gravity: tuple[float, float, float]
    joint_terms: JointTerms | None = None


class SavedStandard(_Record):
    """A standard parameter or joint term, with its value in a consistent fit."""

    name: str
    unit: str
    value: float | None = None


class SavedBase(_Record):
    """A base parameter: coefficients of standard parameters, 1 of the one that names it."""

    name: str
    unit: str
    expression: str
    value: float
    standard_error: Number = math.nan
    relative_std_percent: Number = math.nan
    interval_95_percent: tuple[Number, Number] = (math.nan, math.nan)
    terms: dict[str, float]


class SavedState(_Record):
    """A state of the robot, and the forces that the values give there."""

    configuration: Array
    velocity: Array
    acceleration: Array
    force: Array


class SavedQuality(_Record):
    """As ``Quality``."""

    residual_rms: Column
    r_squared: Column
    samples: Counts


class SavedNoise(_Record):
    """As ``NoiseModel``."""

    actuators: tuple[str, ...]
    coefficients: Column
    innovation: Column
    deviation: Column
    lag_one: Column
    samples: Counts
    effective_samples: Column


class SavedRobustness(_Record):
    """As ``Robustness``."""

    scale: Column
    down_weighted: Column


class SavedEstimate(_Record):
    """What a ``FitResult`` has beside values and covariance."""

    estimator: str
    actuators: tuple[str, ...]
    condition_number: Number
    degrees_of_freedom: Number
    quality: SavedQuality
    weights: Array
    assumed: tuple[str, ...]
    noise: SavedNoise | None = None
    robustness: SavedRobustness | None = None


class SavedCost(_Record):
    """As ``FitCost``."""

    actuators: tuple[str, ...]
    unconstrained: Column
    constrained: Column
    total: Number


class SavedConsistency(_Record):
    """What a ``ConsistentFit`` has beside values."""

    feasible: bool
    fit_cost: SavedCost
    bodies: tuple[str, ...]
    margins: Column
    boundary: tuple[str, ...]
    repaired: tuple[str, ...]
    regularisation: str
    strength: float
    margin: float


class SavedFit(_Record):
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
    consistency : SavedConsistency or None
        Where a ``ConsistentFit`` was saved.
    """

    format: Literal["loopid fit"] = "loopid fit"
    version: Literal[1] = 1
    loopid: str
    robot: SavedRobot
    force_model: SavedForceModel
    standard_parameters: tuple[SavedStandard, ...]
    base_parameters: tuple[SavedBase, ...]
    covariance: Array | None = None
    check: tuple[SavedState, ...] = Field(min_length=1)
    estimate: SavedEstimate | None = None
    consistency: SavedConsistency | None = None

    @classmethod
    def of(cls, model: ForceModel, fit: FitResult | ConsistentFit | FloatArray) -> SavedFit:
        """What is saved of a fit, or of values (r,), of the parameters of a force model.

        Raises
        ------
        DataError
            When the fit is not one of these parameters.
        """
        base, mechanism, fitted = model.base, model.mechanism, model.parameters
        covariance = None
        estimates: Sequence[Estimate | None] = [None] * len(base)
        standard: Sequence[float | None] = [None] * len(base.parameters)
        if isinstance(fit, FitResult):
            fitted, values, covariance = fit.parameters, fit.values, fit.covariance
            estimates = fit.estimates
        elif isinstance(fit, ConsistentFit):
            fitted, values = fit.base_parameters, fit.values
            standard = fit.standard_parameters.tolist()
        else:
            values = finite(fit, "values")
        if fitted != model.parameters or values.shape != (len(base),):
            raise DataError(
                f"a fit of {len(fitted)} parameters with values {values.shape} is none of the "
                f"{len(base)} base parameters of the force model"
            )
        entries = zip(fitted, base.terms, values.tolist(), estimates, strict=True)
        return cls.model_validate(
            {
                "loopid": version("loopid"),
                "robot": {
                    "name": mechanism.name,
                    "files": _hashes(mechanism),
                    "options": dict(mechanism.options),
                    "coordinates": mechanism.coordinates,
                },
                "force_model": {
                    "model": model.model,
                    "rows": mechanism.independent,
                    "gravity": tuple(mechanism.model.gravity.linear.tolist()),
                    "joint_terms": model.joint_terms,
                },
                "standard_parameters": tuple(
                    {"name": parameter.label, "unit": parameter.unit, "value": value}
                    for parameter, value in zip(base.parameters, standard, strict=True)
                ),
                "base_parameters": tuple(_base_entry(*entry) for entry in entries),
                "covariance": covariance,
                "check": _states(model, values),
                "estimate": fit if isinstance(fit, FitResult) else None,
                "consistency": fit if isinstance(fit, ConsistentFit) else None,
            }
        )

    @model_validator(mode="after")
    def _fits_together(self) -> SavedFit:
        labels, names = self.standard.labels, self.parameters.labels
        r, dof = len(names), len(self.force_model.rows)
        for base in self.base_parameters:
            unknown = [label for label in base.terms if label not in labels]
            if unknown or base.terms.get(base.name) != 1:
                raise ValueError(f"the terms of {base.name} are not those of a base parameter")
        if self.covariance is not None and self.covariance.shape != (r, r):
            raise ValueError(f"the covariance must have shape {(r, r)}")
        for state in self.check:
            if not len(state.velocity) == len(state.acceleration) == len(state.force) == dof:
                raise ValueError(f"a state must have {dof} velocities, accelerations and forces")
        if self.estimate is not None and self.covariance is None:
            raise ValueError("an estimate needs a covariance")
        if self.consistency is not None and not np.isfinite(self._standard_values).all():
            raise ValueError("a consistent fit needs the values of all standard parameters")
        _ = self.result  # refused where its columns do not fit together
        return self

    def __repr__(self) -> str:
        kind = "values" if self.estimate is None else self.estimate.estimator
        return (
            f"<SavedFit of {self.robot.name}: {len(self.base_parameters)} base parameters, "
            f"{self.force_model.model} model, {'consistent' if self.consistency else kind}>"
        )

    __str__ = __repr__

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(base.expression)}<td>{base.value:.5g}<td>{base.standard_error:.2g}"
            f"<td>{escape(base.unit)}"
            for base in self.base_parameters
        )
        head = "<tr><th>base parameter<th>value<th>standard error<th>unit"
        return f"<p>{escape(repr(self))}</p><table>{head}{rows}</table>"

    @property
    def standard(self) -> ParameterSet:
        """Names of all p standard parameters and joint terms."""
        return _parameter_set(self.standard_parameters)

    @property
    def parameters(self) -> ParameterSet:
        """The standard parameter that leads each of the r base parameters."""
        return _parameter_set(self.base_parameters)

    @property
    def values(self) -> FloatArray:
        """Base parameters (r,)."""
        return np.array([base.value for base in self.base_parameters])

    @property
    def matrix(self) -> FloatArray:
        """M (r, p) of Φ_base = M Φ."""
        places = {label: j for j, label in enumerate(self.standard.labels)}
        M = np.zeros((len(self.base_parameters), len(places)))
        for row, base in zip(M, self.base_parameters, strict=True):
            row[[places[label] for label in base.terms]] = list(base.terms.values())
        return M

    @property
    def result(self) -> FitResult | ConsistentFit | None:
        """The fit as it was saved; None where only values were."""
        if self.consistency is not None:
            cost = FitCost(**dict(self.consistency.fit_cost))
            return ConsistentFit(
                parameters=self.standard,
                standard_parameters=self._standard_values,
                base_parameters=self.parameters,
                values=self.values,
                **dict(self.consistency) | {"fit_cost": cost},
            )
        if self.estimate is None or self.covariance is None:
            return None
        quality, noise, robustness = (
            None if record is None else kind(**dict(record))
            for kind, record in (
                (Quality, self.estimate.quality),
                (NoiseModel, self.estimate.noise),
                (Robustness, self.estimate.robustness),
            )
        )
        return FitResult(
            parameters=self.parameters,
            values=self.values,
            covariance=self.covariance,
            **dict(self.estimate) | {"quality": quality, "noise": noise, "robustness": robustness},
        )

    @property
    def _standard_values(self) -> FloatArray:
        return np.array([standard.value for standard in self.standard_parameters], dtype=np.float64)

    @checked
    def forces(
        self,
        mechanism: Mechanism,
        configurations: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
    ) -> FloatArray:
        """Forces (N, dof) of a motion in N or N m, along the rows of the force model.

        Parameters
        ----------
        mechanism : Mechanism
            Whose parameters these are.
        configurations : FloatArray
            (N, nq), closed, in m or rad.
        velocities, accelerations : FloatArray
            (N, dof) of the independent coordinates, in m/s or rad/s and their rates.

        Raises
        ------
        DataError
            When the mechanism is another one; see ``require``.
        """
        self.require(mechanism)
        return self._forces(mechanism, configurations, velocities, accelerations)

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
        difference = self._difference(mechanism)
        if difference:
            raise self._refusal(mechanism, difference)

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
        structure, M, labels = analyse(observation), self.matrix, self.standard.labels
        base = np.array([labels.index(name) for name in self.parameters.labels])
        R, sizes = observation.factor, np.linalg.norm(observation.factor, axis=0)
        errors = np.linalg.norm(R - R[:, base] @ M, axis=0)
        allowed = SAME_ROBOT * (sizes + sizes[base] @ np.abs(M)) + NO_EFFECT * sizes.max()
        worst = int(np.argmax(errors / allowed))
        if errors[worst] > allowed[worst]:
            raise self._refusal(mechanism, f"{labels[worst]} has other coefficients there")
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
        return ForceModel(mechanism, kind, terms, found)

    @checked
    def find_standard_parameters(self, model: ForceModel, repair: bool = False) -> FloatArray:
        """Physically consistent standard parameters (p,) with the base parameters of the fit.

        Those of a consistent fit itself; otherwise, of all that there are, those closest to the
        robot file's (``consistent_parameters``).

        Parameters
        ----------
        model : ForceModel
            From ``find_force_model``.
        repair : bool
            Whether bodies that are not consistent as the robot file has them are repaired first.

        Raises
        ------
        FeasibilityError
            Naming bodies, when there are none.
        """
        if self.consistency is not None:
            return self._standard_values
        return consistent_parameters(model.base, self.values, model.standard_prior, repair=repair)

    def record(self) -> dict[str, Any]:
        """All of it in plain numbers, lists and texts, as it stands in the file."""
        return self.model_dump(mode="json", exclude_none=True)

    def content(self, path: str | Path) -> bytes | str:
        """The content of a file of that name."""
        ending, record = _ending(path), self.record()
        if ending == ".npz":
            return self._archive(record)
        if ending == ".json":
            return json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        stream = StringIO()
        _yaml().dump(record, stream)
        return stream.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write to a file, whole or not at all; see ``save_fit``."""
        write_file(path, self.content(path))
        return Path(path)

    def _archive(self, record: dict[str, Any]) -> bytes:
        """Arrays for other programs, and the whole as JSON, which is what is read back."""
        arrays: dict[str, Any] = {
            "document": json.dumps(record, allow_nan=False),
            "rows": self.force_model.rows,
            "names": self.parameters.labels,
            "units": [base.unit for base in self.base_parameters],
            "expressions": [base.expression for base in self.base_parameters],
            "values": self.values,
            "matrix": self.matrix,
            "standard_names": self.standard.labels,
            "standard_units": [standard.unit for standard in self.standard_parameters],
        }
        if self.covariance is not None:
            arrays["covariance"] = self.covariance
        stream = BytesIO()
        np.savez(stream, **arrays)
        return stream.getvalue()

    def _forces(
        self, mechanism: Mechanism, q: FloatArray, v: FloatArray, a: FloatArray
    ) -> FloatArray:
        kind, terms = self.force_model.model, self.force_model.joint_terms
        W = motion_regressor(mechanism, closed_motion(mechanism, q, v, a), kind, terms)
        labels = self.standard.labels
        columns = [labels.index(name) for name in self.parameters.labels]
        return np.asarray(W[..., columns] @ self.values, dtype=np.float64)

    def _difference(self, mechanism: Mechanism) -> str:
        """The first thing that makes a mechanism another robot; empty where there is none."""
        kind, terms = self.force_model.model, self.force_model.joint_terms
        missing = set(() if terms is None else terms.joints) - set(mechanism.joints)
        if missing:
            return f"that has no joint {min(missing)}"
        for what, there, here in (
            ("coordinate", mechanism.coordinates, self.robot.coordinates),
            ("row", mechanism.independent, self.force_model.rows),
            ("parameter", motion_parameters(mechanism, kind, terms).labels, self.standard.labels),
        ):
            for one, other in zip_longest(there, here):
                if one != other:
                    return f"{what} {other or 'none'} is where that has {one or 'none'}"
        gravity = mechanism.model.gravity.linear.tolist()
        if not np.allclose(gravity, self.force_model.gravity, rtol=SAME_ROBOT):
            return f"gravity is {gravity} m/s² there, not {list(self.force_model.gravity)}"
        q, v, a, force = (
            np.array([getattr(state, part) for state in self.check])
            for part in ("configuration", "velocity", "acceleration", "force")
        )
        residual = np.abs(constraint_residual(mechanism, q)).max(axis=0, initial=0.0)
        most = SAME_ROBOT * mechanism.length + 2 * mechanism.closure_residual
        if residual.max(initial=0.0) > most:
            k = int(residual.argmax())
            return f"closure {mechanism.row_names[k]} has a residual of {residual[k]:.3g} there"
        apart = np.abs(self._forces(mechanism, q, v, a) - force).max(axis=0)
        k = int(apart.argmax())
        if apart[k] > SAME_ROBOT * np.abs(force).max():
            return f"the force along {self.force_model.rows[k]} differs by {apart[k]:.3g} there"
        return ""

    def _refusal(self, mechanism: Mechanism, difference: str) -> DataError:
        hashes = _hashes(mechanism).items()
        other = [name for name, hashed in hashes if self.robot.files.get(name) != hashed]
        files = f" ({', '.join(other)}: not the files of the fit)" if other else ""
        return DataError(
            f"this is a fit of {self.robot.name}, not of {mechanism.path}{files}: {difference}"
        )


@checked
def save_fit(
    path: str | Path, model: ForceModel, fit: FitResult | ConsistentFit | FloatArray
) -> Path:
    """Save a fit with all that it takes to use it: for ``read_fit`` and ``loopid export``.

    Parameters
    ----------
    path : path
        Ending in .yaml, .yml, .json or .npz; written whole or not at all.
    model : ForceModel
        Whose parameters were fitted.
    fit : FitResult, ConsistentFit or FloatArray
        Or values (r,) of the base parameters.

    Raises
    ------
    DataError
        When the fit is not one of the parameters of the force model.
    OptionError
        When the name ends otherwise.
    OutputError
        When the file cannot be written.

    Examples
    --------
    >>> import loopid, tempfile
    >>> model = loopid.find_force_model(loopid.load_mechanism("five_bar"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     loopid.save_fit(f"{folder}/fit.json", model, model.prior).name
    'fit.json'
    """
    return SavedFit.of(model, fit).save(path)


@checked
def read_fit(path: str | Path) -> SavedFit:
    """Read a fit that ``save_fit`` or ``loopid identify`` wrote, the same to the bit.

    Raises
    ------
    MissingFileError
        When there is no such file.
    DataError
        When it is no saved fit, or damaged: what is missing or makes no sense.
    OptionError
        When the name ends otherwise than .yaml, .yml, .json or .npz.

    Examples
    --------
    >>> import loopid, tempfile
    >>> robot = loopid.load_mechanism("five_bar")
    >>> model = loopid.find_force_model(robot)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = loopid.save_fit(f"{folder}/fit.yaml", model, 1.1 * model.prior)
    ...     saved = loopid.read_fit(path)
    >>> saved
    <SavedFit of five_bar: 6 base parameters, gravity model, values>
    >>> q = loopid.random_configurations(robot, 4, seed=1)
    >>> saved.forces(robot, q, 0 * q[:, :2], 0 * q[:, :2]).shape
    (4, 2)
    """
    try:
        return SavedFit.model_validate_json(_document(Path(path)))
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        place = ".".join(str(key) for key in detail["loc"])
        found = f"{place}: {detail['msg']}" if place else detail["msg"]
        raise DataError(f"{path} is not a saved fit: {found}") from error


def _document(path: Path) -> str:
    """The JSON of a saved file, whichever its ending."""
    ending, reason = _ending(path), why_no_file(path)
    if reason == "does not exist":
        raise MissingFileError(f"there is no file {path}")
    if reason:
        raise DataError(f"{path} {reason}")
    try:
        if ending == ".npz":
            with np.load(path, allow_pickle=False) as archive:
                return str(archive["document"])
        text = path.read_text(encoding="utf-8")
        return text if ending == ".json" else json.dumps(_yaml().load(text))
    except (ArithmeticError, AttributeError, BadZipFile, EOFError, LookupError, OSError,
            RecursionError, TypeError, ValueError, YAMLError) as error:  # fmt: skip
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise DataError(f"{path} cannot be read: {reason}") from error


def _ending(path: str | Path) -> str:
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise OptionError.unknown("ending", ending or str(path), ENDINGS)
    return ending


def _yaml() -> YAML:
    yaml = YAML(typ="safe", pure=True)
    yaml.allow_unicode = True
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.default_flow_style = None
    return yaml


def _parameter_set(entries: Iterable[SavedStandard | SavedBase]) -> ParameterSet:
    parsed = ((Parameter.parse(entry.name), entry.unit) for entry in entries)
    return ParameterSet(tuple(Parameter(found.link, found.kind, unit) for found, unit in parsed))


def _base_entry(
    parameter: Parameter, terms: dict[str, float], value: float, estimate: Estimate | None
) -> dict[str, Any]:
    """A base parameter, with its uncertainty where an ``Estimate`` says it."""
    entry: dict[str, Any] = {"name": parameter.label, "unit": parameter.unit}
    entry["expression"] = expression(terms)
    if estimate is not None:
        entry |= {
            "standard_error": estimate.standard_error,
            "relative_std_percent": estimate.relative_std,
            "interval_95_percent": estimate.interval,
        }
    return entry | {"value": value, "terms": terms}


def _hashes(mechanism: Mechanism) -> dict[str, str]:
    """SHA-256 of the files of a robot, by name."""
    files = find_files(mechanism.path)
    return {f.name: sha256(f.read_bytes()).hexdigest() for f in (files.named, files.tree)}


def _states(model: ForceModel, values: FloatArray) -> tuple[dict[str, FloatArray], ...]:
    """Random states, the same for the same robot, with the forces there."""
    q = random_configurations(model.mechanism, STATES, seed=0)
    v, a = np.random.default_rng(0).standard_normal((2, STATES, len(model.mechanism.independent)))
    force = model.base.regressor(model.standard_regressor(q, v, a)) @ values
    names = "configuration", "velocity", "acceleration", "force"
    return tuple(dict(zip(names, state, strict=True)) for state in zip(q, v, a, force, strict=True))
