"""The file of a fit: all that it takes to use its values, written and read.

It holds which combinations of standard parameters the values are, the options of the force model,
and how the robot was loaded. States with the forces there are in it, too: by these the robot is
known again. Reading never repeats a search for base parameters. A digest vouches for the content:
what has one was written by ``Fit.save`` and not changed since, and is taken as it is.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from hashlib import sha256
from importlib.metadata import version
from itertools import zip_longest
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np

from loopid.arguments import FloatArray, frozen
from loopid.base_parameters.base import BaseParameters, expression
from loopid.base_parameters.choice import SearchResult
from loopid.base_parameters.structure import Structure, analyse
from loopid.errors import DataError, FileError, LoopidError, shown
from loopid.files import near_file, require_ending, why_no_file
from loopid.identification.estimates import Estimates
from loopid.identification.force_models import ForceModel
from loopid.kinematics.constraint import constraint_residual
from loopid.kinematics.sampling import random_configurations
from loopid.loading.closure import Closure, Coupling, not_in
from loopid.loading.files import bundled_directory, find_files, own_files
from loopid.parameters import Parameter, ParameterSet
from loopid.records import json_value, record
from loopid.regressors.joint_terms import JointTerms
from loopid.regressors.motion_regressors import motion_parameters
from loopid.regressors.structural import structural_observation
from loopid.robot.robot import Robot

Kind = TypeVar("Kind", bound=Estimates)

ENDINGS = (".yaml", ".yml", ".json")
FORM, VERSION = "loopid fit", 3  # another version is refused
STATES = 3  # of the robot, by which it is known again
# Relative difference of closures, forces and columns of one robot; of base parameters from those of
# the standard parameters.
SAME_ROBOT, FOLLOWS = 1e-6, 1e-9
NO_EFFECT = 1e-10  # of a column, relative to the largest
# What a fit knows that is in sections of its own.
APART = {"parameters", "values", "covariance", "standard_parameters", "model"}


@record
class FitFile:
    """The content of the file of a fit, in plain numbers, lists and texts."""

    content: dict[str, Any]

    @classmethod
    def of(cls, fit: Estimates) -> FitFile:
        """What is written of a fit, which knows its model."""
        model = fit.require_model()
        _require_own_bodies(fit, model)
        robot, base, bodies = model.robot, model.base, fit.standard_parameters
        values = [None] * len(base.parameters) if bodies is None else bodies.tolist()
        kept = "name", "unit", "value", "standard_error", "determined"
        content = {
            "format": FORM,
            "version": VERSION,
            "loopid": version("loopid"),
            "robot": {
                "name": robot.name,
                "path": _place(robot),
                "files": _hashes(robot),
                "options": robot.options,
                "coordinates": robot.coordinates,
            },
            # Forces are along the coordinates named by the rows.
            "force_model": {
                "model": model.model,
                "rows": robot.independent,
                "gravity": robot.model.gravity.linear,
                "joint_terms": model.joint_terms,
            },
            # All p standard parameters and joint terms, with values where the fit has bodies.
            "standard_parameters": [
                {name: getattr(each, name) for name in kept} for each in fit.standard.values()
            ]
            or [
                {"name": parameter.label, "unit": parameter.unit, "value": value}
                for parameter, value in zip(base.parameters, values, strict=True)
            ],
            # Terms are coefficients of standard parameters, 1 of the first, which leads them.
            "base_parameters": [
                {
                    **{"name": x.name, "unit": x.unit, "value": x.value},
                    **{"expression": expression(terms), "terms": terms},
                    "standard_error": x.standard_error,
                    "relative_std_percent": x.relative_std,
                    "interval_95_percent": x.interval,
                }
                for x, terms in zip(fit.estimates, base.terms, strict=True)
            ],
            "covariance": fit.covariance,
            "check": _states(model, fit.values),
            "estimate": {
                each.name: getattr(fit, each.name)
                for each in fields(Estimates)
                if each.name not in APART
            },
        }
        plain: dict[str, Any] = json_value(content, nulls=False)
        return cls(plain | {"digest": digest(plain)})

    @classmethod
    def read(cls, path: str | Path) -> FitFile:
        """Read a file; see ``load_fit`` for what is refused."""
        place = Path(path)
        if reason := why_no_file(place):
            if reason == "does not exist":
                raise FileError(f"{path} {reason}{near_file(place)}", file=path)
            raise DataError(f"{path} {reason}", file=path)
        require_ending(place, ENDINGS)
        try:
            content = json.loads(place.read_bytes())
        except (ValueError, RecursionError) as error:
            raise DataError(
                f"{path} is not a saved fit, which is JSON: it is cut short, damaged or written by "
                f"another program ({error})",
                file=path,
            ) from error
        if not isinstance(content, dict) or content.get("format") != FORM:
            raise DataError(f"{path} is not a saved fit: its format is not {FORM!r}", file=path)
        if (form := content.get("version", "unknown")) != VERSION:
            raise DataError(
                f"{path} is a fit in form {shown(form)}, and this loopid reads form {VERSION}: "
                "identify the log again and save the fit",
                field="version",
            )
        if content.get("digest") != digest(content):
            raise DataError(
                f"{path} was changed after it was written: its digest is not that of its content, "
                "so write it anew by fit.save",
                field="digest",
            )
        return cls(content)

    # What it is made into.

    @property
    def robot(self) -> dict[str, Any]:
        """Name, path then, SHA-256 of the files, how they were loaded, and coordinates."""
        return dict(self.content["robot"])

    @property
    def force_model(self) -> dict[str, Any]:
        """The model, its rows, gravity and joint terms."""
        return dict(self.content["force_model"])

    @property
    def joint_terms(self) -> JointTerms | None:
        """Those of the force model."""
        given = self.force_model.get("joint_terms")
        return None if given is None else JointTerms(**given)

    def fit(self, kind: type[Kind], model: ForceModel | None = None) -> Kind:
        """A ``Fit``, or what it has of ``Estimates``, the same to the bit."""
        estimate = dict(self.content["estimate"])
        if known := estimate.get("uncertainty"):
            ends = ("file", "degrees_of_freedom")  # null where infinite
            found = {name: [math.inf if x is None else x for x in known[name]] for name in ends}
            estimate["uncertainty"] = known | found
        for name, hint in get_type_hints(Estimates).items():
            own: Any = next(filter(is_dataclass, (hint, *get_args(hint))), None)
            if own is not None and name in estimate:
                estimate[name] = own(**estimate[name])
        values = [each.get("value") for each in self.content["standard_parameters"]]
        estimate |= {
            "parameters": self.parameters,
            "values": [each["value"] for each in self.content["base_parameters"]],
            "covariance": self.content["covariance"],
            "standard_parameters": None if None in values else values,
        }
        return kind(**estimate, model=model)

    @property
    def standard(self) -> ParameterSet:
        """Names of all p standard parameters and joint terms."""
        every = self.content["standard_parameters"]
        return ParameterSet(
            tuple(replace(Parameter.parse(each["name"]), unit=each["unit"]) for each in every)
        )

    @property
    def matrix(self) -> FloatArray:
        """M (r, p) of Φ_base = M Φ."""
        labels, every = self.standard.labels, self.content["base_parameters"]
        return np.array([[each["terms"].get(label, 0.0) for label in labels] for each in every])

    @property
    def parameters(self) -> ParameterSet:
        """The r base parameters, each with its sum."""
        found = []
        for each in self.content["base_parameters"]:
            leading, *others = each["terms"]
            own = replace(Parameter.parse(leading), unit=each["unit"], others=tuple(others))
            found.append(replace(own, expression=each["expression"]))
        return ParameterSet(tuple(found))

    def load_robot(self, file: str | Path | None = None) -> Robot:
        """The robot, loaded as it was then: from a file, or from where it was."""
        own, place = self.robot, file or self.robot["path"]
        if not place:
            raise FileError(
                f"the robot of the fit, {own['name']}, was made in Python: make it again, for "
                "load_fit(path, robot=...)",
                robot=own["name"],
            )
        from loopid.loading.robot_files import load  # readers, which fits made in Python do without

        closures = [
            (Coupling if "joints" in each else Closure)(**each)
            for each in own["options"].get("closures", ())
        ]
        try:
            # A YAML that was written beside an exported file has them, too.
            closures = not_in(find_files(place).given, closures)
            return load(place, **own["options"] | {"closures": closures})
        except FileError:
            if file is not None:
                raise
            raise FileError(
                f"the robot of the fit, {own['name']}, is no longer at {own['path']}: say where it "
                'is, robot="FILE"',
                file=own["path"],
            ) from None
        except LoopidError as error:
            if file is None:
                raise
            raise DataError(
                f"{file} cannot be loaded as the robot of the fit, {own['name']}: {error}"
            ) from error

    def model_of(self, robot: Robot) -> ForceModel:
        """The force model of a robot with the base parameters of the file: nothing is searched.

        A DataError names the first thing in which it is another robot. Compared are names of
        coordinates, rows and parameters, and gravity. Then come loops that must close at the
        states, forces there, and coefficients. Inertials may differ, as in robot files that were
        exported.
        """
        self._require_same_layout(robot)
        kind, terms = self.force_model["model"], self.joint_terms
        observation = structural_observation(robot, kind, joint_terms=terms)
        model = ForceModel(robot, kind, terms, self._base(analyse(observation)))
        self._require_same_numbers(model, observation.factor)
        return model

    def _other(self, robot: Robot, difference: str) -> DataError:
        """An error that names a difference, and which files are others."""
        hashes, known = _hashes(robot).items(), self.robot["files"]
        other = [name for name, hashed in hashes if known.get(name) != hashed]
        files = f" ({', '.join(other)}: not the files of the fit)" if other else ""
        return DataError(
            f"this is a fit of {self.robot['name']}, not of {robot.source}{files}: {difference}"
        )

    def _require_same_layout(self, robot: Robot) -> None:
        """Refuse other names, gravity or loops, before any model of the robot is made."""
        own = self.force_model

        def require_same(what: str, there: Sequence[str], here: Sequence[str]) -> None:
            for one, other in zip_longest(there, here):
                if one != other:
                    said = f"{what} {other or 'none'} of the fit is {one or 'none'} there"
                    raise self._other(robot, said)

        require_same("coordinate", robot.coordinates, self.robot["coordinates"])
        require_same("row", robot.independent, own["rows"])
        labels = motion_parameters(robot, own["model"], self.joint_terms).labels
        require_same("parameter", labels, self.standard.labels)
        gravity = robot.model.gravity.linear.tolist()
        if not np.allclose(gravity, own["gravity"], rtol=SAME_ROBOT):
            raise self._other(robot, f"gravity is {gravity} m/s² there, not {own['gravity']}")
        q = np.array(self.content["check"]["configurations"])
        residual = np.abs(constraint_residual(robot, q)).max(axis=0, initial=0.0)
        if residual.max(initial=0.0) > SAME_ROBOT * robot.length + 2 * robot.closure_residual:
            k = int(residual.argmax())
            said = f"closure {robot.row_names[k]} has a residual of {residual[k]:.3g} there"
            raise self._other(robot, said)

    def _require_same_numbers(self, model: ForceModel, R: FloatArray) -> None:
        """Refuse other forces or coefficients; R is the triangular factor of all columns."""
        fit = self.fit(Estimates, model)
        names = "configurations", "velocities", "accelerations", "forces"
        *state, forces = (np.array(self.content["check"][name]) for name in names)
        apart = np.abs(_forces(fit.require_model(), fit.values, *state) - forces).max(axis=0)
        k = int(apart.argmax())
        if apart[k] > SAME_ROBOT * np.abs(forces).max():
            terms = model.joint_terms
            why = " (bodies that load joints count)" if terms is not None and terms.loaded else ""
            row = self.force_model["rows"][k]
            said = f"the force along {row} differs by {apart[k]:.3g} there{why}"
            raise self._other(model.robot, said)
        M, own, sizes = self.matrix, model.base.base, np.linalg.norm(R, axis=0)
        errors = np.linalg.norm(R - R[:, own] @ M, axis=0)
        allowed = SAME_ROBOT * (sizes + sizes[own] @ np.abs(M)) + NO_EFFECT * sizes.max()
        if (errors > allowed).any():
            worst = self.standard.labels[int(np.argmax(errors / allowed))]
            raise self._other(model.robot, f"{worst} has other coefficients there")

    def _base(self, structure: Structure) -> BaseParameters:
        """The base parameters of the file, for what a robot lets be known."""
        labels, M = self.standard.labels, self.matrix
        leading = [next(iter(each["terms"])) for each in self.content["base_parameters"]]
        base = np.array([labels.index(label) for label in leading])
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
    if (bodies := fit.standard_parameters) is None:
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


def digest(content: dict[str, Any]) -> str:
    """SHA-256 of a content but for where its robot was, which may move."""
    rest = {key: value for key, value in content.items() if key != "digest"}
    if isinstance(robot := content.get("robot"), dict):
        place = ("name", "path", "files")
        rest["robot"] = {key: value for key, value in robot.items() if key not in place}
    return sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _states(model: ForceModel, values: FloatArray) -> dict[str, FloatArray]:
    """Random states, the same for the same robot, and the forces there."""
    q = random_configurations(model.robot, STATES, seed=0)
    shape = 2, STATES, len(model.robot.independent)
    v, a = np.random.default_rng(0).standard_normal(shape)
    forces = _forces(model, values, q, v, a)
    return {"configurations": q, "velocities": v, "accelerations": a, "forces": forces}


def _forces(
    model: ForceModel, values: FloatArray, q: FloatArray, v: FloatArray, a: FloatArray
) -> FloatArray:
    W = model.base.regressor(model.standard_regressor(q, v, a))
    return np.asarray(model.loaded(W) @ values)


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
