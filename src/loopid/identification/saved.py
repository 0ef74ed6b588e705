"""Saved fits: one schema for everything that is identified and written to a file.

A file holds all that it takes to use its values: which combinations of standard parameters they
are, the options of the force model, how the robot was loaded, and states with the forces there, by
which the robot is known again. Reading one never repeats a search for base parameters.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from hashlib import sha256
from html import escape
from importlib.metadata import version
from io import StringIO
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    ValidationError,
    model_validator,
)

from loopid.arguments import FloatArray, Number, checked, finite, frozen
from loopid.base_parameters.base import BaseParameters, expression
from loopid.base_parameters.choice import SearchResult
from loopid.base_parameters.structure import analyse
from loopid.errors import DataError, FileError, LoopidError, OptionError
from loopid.files import require_other_file, why_no_file, write_file
from loopid.identification.consistent import ConsistentFit, FitCost, consistent_parameters
from loopid.identification.consistent_program import repaired_prior
from loopid.identification.force_model import ForceModel
from loopid.identification.result import FitResult, NoiseModel, Quality, Robustness
from loopid.kinematics.constraint import constraint_residual
from loopid.kinematics.projection import closed_motion
from loopid.kinematics.sampling import random_configurations
from loopid.loading.files import bundled_robots, find_files
from loopid.loading.load import load_mechanism
from loopid.parameters import Parameter, ParameterSet, html_table
from loopid.regressors.closed_loop import motion_parameters, motion_regressor
from loopid.regressors.joint_terms import JointTerms
from loopid.regressors.structural import structural_observation
from loopid.robot.mechanism import Mechanism
from loopid.yaml_files import LARGE, load_yaml, yaml_writer

ENDINGS = (".yaml", ".yml", ".json")
STATES = 3  # of the robot, by which it is known again
# Relative difference of closures, forces and columns up to which a robot is the same.
SAME_ROBOT = 1e-6
# Mass that a body may have, over the robot file's; as which a body without one counts, of the mean.
MOST_MASS, LIGHT = 3.0, 0.01
NO_EFFECT = 1e-10  # of a column, relative to the largest

Array = Annotated[FloatArray, PlainValidator(lambda given: frozen(finite(given, "numbers")))]
Column = Annotated[FloatArray, PlainValidator(lambda given: frozen(given))]  # NaN where null


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError(f"must not be negative, but is {value}")
    return value


class _Record(BaseModel):
    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        from_attributes=True,
        arbitrary_types_allowed=True,  # arrays: lists in the file
        defer_build=True,  # by the first use: importing loopid does not wait for it
    )


class SavedOptions(_Record):
    """Arguments of ``load_mechanism`` beside the path."""

    lock: tuple[str, ...] = ()
    floating_base: bool = False
    free_mimics: bool = False
    tied: bool = False
    rounding: float | None = None


class SavedRobot(_Record):
    """The robot: name, path then, SHA-256 of its files, how they were loaded, its coordinates."""

    name: str
    path: str = ""
    files: dict[str, str]
    options: SavedOptions
    coordinates: tuple[str, ...] = Field(min_length=1)


class SavedForceModel(_Record):
    """The options of the force model; forces are along the coordinates named by its rows."""

    model: Literal["gravity", "full"]
    rows: tuple[str, ...] = Field(min_length=1)
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
    standard_error: Annotated[Number, AfterValidator(_not_negative)] = math.nan
    relative_std_percent: Number = math.nan
    interval_95_percent: tuple[Number, Number] = (math.nan, math.nan)
    terms: dict[str, float]


class SavedState(_Record):
    """A state of the robot, and the forces that the values give there."""

    configuration: Array
    velocity: Array
    acceleration: Array
    force: Array


class SavedEstimate(_Record):
    """What a ``FitResult`` has beside values and covariance."""

    estimator: str
    actuators: tuple[str, ...]
    condition_number: Number
    degrees_of_freedom: Column
    quality: Quality
    weights: Array
    assumed: tuple[str, ...]
    noise: NoiseModel | None = None
    robustness: Robustness | None = None


class SavedConsistency(_Record):
    """What a ``ConsistentFit`` has beside values."""

    feasible: bool
    fit_cost: FitCost
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
    standard_parameters: tuple[SavedStandard, ...] = Field(min_length=1)
    base_parameters: tuple[SavedBase, ...] = Field(min_length=1)
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
        base, values = model.base, _values_of(model, fit)
        standard: Sequence[float | None] = [None] * len(base.parameters)
        if isinstance(fit, ConsistentFit):
            standard = fit.standard_parameters.tolist()
        return cls.model_validate(
            {
                "loopid": version("loopid"),
                "robot": _robot_of(model.mechanism),
                "force_model": _options_of(model),
                "standard_parameters": tuple(
                    {"name": p.label, "unit": p.unit, "value": value}
                    for p, value in zip(base.parameters, standard, strict=True)
                ),
                "base_parameters": tuple(_entries_of(model, fit, values)),
                "covariance": fit.covariance if isinstance(fit, FitResult) else None,
                "check": tuple(_states_of(model, values)),
                "estimate": fit if isinstance(fit, FitResult) else None,
                "consistency": fit if isinstance(fit, ConsistentFit) else None,
            }
        )

    @model_validator(mode="after")
    def _fits_together(self) -> SavedFit:
        labels, names = self.standard.labels, self.parameters.labels
        dof = len(self.force_model.rows)
        for base in self.base_parameters:
            unknown = [label for label in base.terms if label not in labels]
            if unknown or base.terms.get(base.name) != 1:
                raise ValueError(f"the terms of {base.name} are not those of a base parameter")
        if self.covariance is not None:
            self._require_covariance(self.covariance, names)
        for state in self.check:
            if not len(state.velocity) == len(state.acceleration) == len(state.force) == dof:
                raise ValueError(f"a state must have {dof} velocities, accelerations and forces")
            if len(state.configuration) != len(self.check[0].configuration):
                raise ValueError("configurations of the states differ in length")
        if self.estimate is not None and self.covariance is None:
            raise ValueError("an estimate needs a covariance")
        if self.consistency is not None and not np.isfinite(self.standard_values).all():
            raise ValueError("a consistent fit needs the values of all standard parameters")
        _ = self.result  # refused where its columns do not fit together
        return self

    def _require_covariance(self, C: FloatArray, names: Sequence[str]) -> None:
        if C.shape != (len(names), len(names)):
            raise ValueError(f"the covariance must have shape {(len(names), len(names))}")
        for name, variance in zip(names, np.diag(C).tolist(), strict=True):
            if variance < 0:
                raise ValueError(f"the variance of {name} must not be negative, but is {variance}")
        sizes = np.sqrt(np.diag(C))
        impossible = np.abs(C) > (1 + SAME_ROBOT) * np.outer(sizes, sizes)
        if impossible.any() or np.abs(C - C.T).max() > SAME_ROBOT * np.abs(C).max():
            raise ValueError("the covariance must be symmetric, with correlations from -1 to 1")

    def __repr__(self) -> str:
        kind = "values" if self.estimate is None else self.estimate.estimator
        return (
            f"<SavedFit of {self.robot.name}: {len(self.base_parameters)} base parameters, "
            f"{self.force_model.model} model, {'consistent' if self.consistency else kind}>"
        )

    __str__ = __repr__

    def _repr_html_(self) -> str:
        rows = (
            (base.expression, f"{base.value:.5g}", f"{base.standard_error:.2g}", base.unit)
            for base in self.base_parameters
        )
        head = ("base parameter", "value", "standard error", "unit")
        return f"<p>{escape(repr(self))}</p>{html_table(head, rows)}"

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
            return ConsistentFit(
                parameters=self.standard,
                standard_parameters=self.standard_values,
                base_parameters=self.parameters,
                values=self.values,
                **dict(self.consistency),
            )
        if self.estimate is None or self.covariance is None:
            return None
        return FitResult(
            parameters=self.parameters,
            values=self.values,
            covariance=self.covariance,
            **dict(self.estimate),
        )

    @property
    def standard_values(self) -> FloatArray:
        """Values (p,) of the standard parameters; NaN where the file gives none."""
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
        for difference in self._differences(mechanism):
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
        if (errors > allowed).any():
            worst = labels[int(np.argmax(errors / allowed))]
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
        return ForceModel(mechanism, kind, terms, found)

    @checked
    def find_standard_parameters(
        self, model: ForceModel, *, repair: bool = False, any_mass: bool = False
    ) -> FloatArray:
        """Physically consistent standard parameters (p,) with the base parameters of the fit.

        Those of a consistent fit itself; otherwise, of all that there are, those closest to the
        robot file's (``consistent_parameters``).

        Parameters
        ----------
        model : ForceModel
            From ``find_force_model``.
        repair : bool
            Whether inconsistent bodies of the robot file are repaired first.
        any_mass : bool
            Whether bodies of a fit that is not a consistent one may weigh more than ``MOST_MASS``
            times what the robot file says.

        Raises
        ------
        DataError
            Naming bodies, when there are none, or when one would be that heavy.
        """
        if self.consistency is not None:
            return self.standard_values
        prior, columns = model.standard_prior, self.standard
        if repair:
            prior = repaired_prior(columns, prior)
        # The distance that keeps masses near the prior's where nothing is known of them.
        given = model.base, self.values, prior
        standard = consistent_parameters(*given, regularisation="euclidean")
        masses = [j for j, parameter in enumerate(columns) if parameter.kind == "m"]
        # A body without a mass of its own in the file counts as a light one.
        known = np.maximum(prior[masses], LIGHT * np.abs(prior[masses]).mean())
        ratios = standard[masses] / np.where(known > 0, known, np.inf)
        worst = int(ratios.argmax())
        if ratios[worst] > MOST_MASS and not any_mass:
            j = masses[worst]
            bayes = self.estimate is not None and self.estimate.estimator == "bayes"
            other = "" if bayes else "it as a prior (estimator='bayes'), or "
            raise DataError(
                f"{columns[j].label} would be {standard[j]:.3g} kg, {ratios[worst]:.3g} times what "
                f"the robot file says (most {MOST_MASS:g} times): use {other}a consistent fit "
                "(consistent='entropic', which writes standard_parameters.yaml); if the robot is "
                "that heavy, any_mass=True",
                parameter=columns[j].label,
                mass=float(standard[j]),
                ratio=float(ratios[worst]),
            )
        return standard

    def record(self) -> dict[str, Any]:
        """All of it in plain numbers, lists and texts, as it stands in the file."""
        record: dict[str, Any] = _plain(self.model_dump())
        return record

    def content(self, path: str | Path) -> str:
        """The content of a file of that name."""
        ending, record = _ending(path), self.record()
        if ending == ".json":
            return json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        text = StringIO()
        yaml_writer().dump(record, text)
        return text.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write to a file, whole or not at all; see ``save_fit``."""
        write_file(path, self.content(path))
        return Path(path)

    def _forces(
        self, mechanism: Mechanism, q: FloatArray, v: FloatArray, a: FloatArray
    ) -> FloatArray:
        kind, terms = self.force_model.model, self.force_model.joint_terms
        W = motion_regressor(mechanism, closed_motion(mechanism, q, v, a), kind, joint_terms=terms)
        columns = [self.standard.labels.index(name) for name in self.parameters.labels]
        return np.asarray(W[..., columns] @ self.values, dtype=np.float64)

    def _differences(self, mechanism: Mechanism) -> Iterator[str]:
        """What makes a mechanism another robot: only the first counts, the next build on it."""
        kind, terms = self.force_model.model, self.force_model.joint_terms
        known = {*mechanism.joints, *mechanism.coordinates}
        missing = set(() if terms is None else terms.joints) - known
        if missing:
            yield f"that has no joint {min(missing)}"
        for what, there, here in (
            ("coordinate", mechanism.coordinates, self.robot.coordinates),
            ("row", mechanism.independent, self.force_model.rows),
            ("parameter", motion_parameters(mechanism, kind, terms).labels, self.standard.labels),
        ):
            for one, other in zip_longest(there, here):
                if one != other:
                    yield f"{what} {other or 'none'} is where that has {one or 'none'}"
        gravity = mechanism.model.gravity.linear.tolist()
        if not np.allclose(gravity, self.force_model.gravity, rtol=SAME_ROBOT):
            yield f"gravity is {gravity} m/s² there, not {list(self.force_model.gravity)}"
        q, v, a, force = (
            np.array([getattr(state, part) for state in self.check])
            for part in ("configuration", "velocity", "acceleration", "force")
        )
        residual = np.abs(constraint_residual(mechanism, q)).max(axis=0, initial=0.0)
        most = SAME_ROBOT * mechanism.length + 2 * mechanism.closure_residual
        if residual.max(initial=0.0) > most:
            k = int(residual.argmax())
            yield f"closure {mechanism.row_names[k]} has a residual of {residual[k]:.3g} there"
        apart = np.abs(self._forces(mechanism, q, v, a) - force).max(axis=0)
        k = int(apart.argmax())
        if apart[k] > SAME_ROBOT * np.abs(force).max():
            why = " (bodies that load joints count)" if terms is not None and terms.loaded else ""
            row = self.force_model.rows[k]
            yield f"the force along {row} differs by {apart[k]:.3g} there{why}"

    def _refusal(self, mechanism: Mechanism, difference: str) -> DataError:
        hashes = _hashes(mechanism).items()
        other = [name for name, hashed in hashes if self.robot.files.get(name) != hashed]
        files = f" ({', '.join(other)}: not the files of the fit)" if other else ""
        return DataError(
            f"this is a fit of {self.robot.name}, not of {mechanism.path}{files}: {difference}"
        )


def _values_of(model: ForceModel, fit: FitResult | ConsistentFit | FloatArray) -> FloatArray:
    """Base parameters (r,) of a fit, which must be those of the force model."""
    fitted = model.parameters
    if isinstance(fit, FitResult):
        fitted, values = fit.parameters, fit.values
    elif isinstance(fit, ConsistentFit):
        fitted, values = fit.base_parameters, fit.values
    else:
        values = finite(fit, "values")
    if fitted != model.parameters or values.shape != (len(model.base),):
        raise DataError(
            f"a fit of {len(fitted)} parameters with values {values.shape} is none of the "
            f"{len(model.base)} base parameters of the force model"
        )
    return values


def _robot_of(mechanism: Mechanism) -> dict[str, Any]:
    return {
        "name": mechanism.name,
        "path": str(mechanism.path),
        "files": _hashes(mechanism),
        "options": dict(mechanism.options),
        "coordinates": mechanism.coordinates,
    }


def _options_of(model: ForceModel) -> dict[str, Any]:
    return {
        "model": model.model,
        "rows": model.mechanism.independent,
        "gravity": tuple(model.mechanism.model.gravity.linear.tolist()),
        "joint_terms": model.joint_terms,
    }


def _entries_of(
    model: ForceModel, fit: FitResult | ConsistentFit | FloatArray, values: FloatArray
) -> Iterator[dict[str, Any]]:
    """An entry for each base parameter, with its uncertainty where the fit has one."""
    known = fit.estimates if isinstance(fit, FitResult) else ()
    estimates = {estimate.name: estimate for estimate in known}
    entries = zip(model.parameters, model.base.terms, values.tolist(), strict=True)
    for parameter, terms, value in entries:
        entry = {"name": parameter.label, "unit": parameter.unit, "value": value}
        entry |= {"expression": expression(terms), "terms": dict(terms)}
        if (estimate := estimates.get(parameter.label)) is not None:
            entry["standard_error"] = estimate.standard_error
            entry["relative_std_percent"] = estimate.relative_std
            entry["interval_95_percent"] = estimate.interval
        yield entry


def _states_of(model: ForceModel, values: FloatArray) -> Iterator[dict[str, FloatArray]]:
    """Random states, the same for the same robot, and the forces there."""
    q = random_configurations(model.mechanism, STATES, seed=0)
    shape = 2, STATES, len(model.mechanism.independent)
    v, a = np.random.default_rng(0).standard_normal(shape)
    force = model.base.regressor(model.standard_regressor(q, v, a)) @ values
    states = {"configuration": q, "velocity": v, "acceleration": a, "force": force}
    for k in range(STATES):
        yield {name: array[k] for name, array in states.items()}


@checked
def save_fit(
    path: str | Path, model: ForceModel, fit: FitResult | ConsistentFit | FloatArray
) -> Path:
    """Save a fit with all that it takes to use it: for ``read_fit`` and ``loopid export``.

    Parameters
    ----------
    path : path
        Ending in .yaml, .yml or .json; written whole or not at all.
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
    return SavedFit.of(model, fit).save(path)


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
    >>> q = loopid.random_configurations(robot, 4, seed=1)
    >>> saved.forces(robot, q, 0 * q[:, :2], 0 * q[:, :2]).shape
    (4, 2)
    """
    document = _document(Path(path))
    try:
        return SavedFit.model_validate_json(document)
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        where = "".join(f"{key}." for key in detail["loc"])[:-1]
        found = f"{where}: {detail['msg']}" if where else detail["msg"]
        raise DataError(f"{path} is not a saved fit: {found}", field=where) from error
    except (TypeError, OverflowError) as error:  # of whole numbers that are none
        raise DataError(f"{path} is not a saved fit: {error}") from error


def _document(path: Path) -> str:
    """The content of a file as JSON, each key once."""
    ending, reason = _ending(path), why_no_file(path)
    if reason == "does not exist":
        raise FileError(f"there is no file {path}", file=path)
    if reason:
        raise DataError(f"{path} {reason}", file=path)
    try:
        if ending != ".json":
            return json.dumps(load_yaml(path, DataError, LARGE))
        if path.stat().st_size > LARGE:
            raise ValueError(f"it holds more than the {LARGE:,} bytes of a fit")
        document = path.read_text(encoding="utf-8")
        json.loads(document, object_pairs_hook=_each_once)
        return document
    except LoopidError:  # which names the file
        raise
    except (OSError, RecursionError, TypeError, ValueError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise DataError(f"{path} cannot be read: {reason}", file=path) from error


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse keys that are given twice, of which the last one would count."""
    found = dict(pairs)
    if len(found) < len(pairs):
        ((name, _),) = Counter(name for name, _ in pairs).most_common(1)
        raise ValueError(f"key {name!r} is given twice")
    return found


def _ending(path: str | Path) -> str:
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise OptionError.unknown("ending", ending or str(path), ENDINGS)
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


def _hashes(mechanism: Mechanism) -> dict[str, str]:
    """SHA-256 of the files of a robot, by name."""
    return {f.name: sha256(f.read_bytes()).hexdigest() for f in robot_files(mechanism)}


def robot_files(mechanism: Mechanism) -> tuple[Path, Path]:
    """The file that a mechanism was loaded from, and that of its tree, which may be the same."""
    files = find_files(mechanism.path)
    return files.named, files.tree
