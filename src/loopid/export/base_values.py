"""Base parameters with all that it takes to use them elsewhere, in YAML, JSON or NPZ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from loopid.arguments import checked, checked_fields
from loopid.arrays import FloatArray, finite, frozen
from loopid.base_parameters import expression
from loopid.errors import DataError, OptionError
from loopid.experiment import ForceModel
from loopid.export import base_npz, base_yaml
from loopid.files import write_file
from loopid.kinematics import closed_motion
from loopid.parameters import ParameterSet
from loopid.regressors import JointTerms, motion_parameters, motion_regressor
from loopid.robot import Mechanism

FORMATS = {".yaml": base_yaml, ".yml": base_yaml, ".json": base_yaml, ".npz": base_npz}


@checked_fields
@dataclass(frozen=True, eq=False)
class BaseValues:
    """Values of base parameters, and which combinations of standard parameters they are.

    Attributes
    ----------
    robot : str
        Name of the mechanism.
    model : str
        ``"gravity"`` or ``"full"``.
    version : str
        Of loopid.
    rows : tuple of str
        Independent coordinates, along which forces are.
    joint_terms : JointTerms or None
    standard : ParameterSet
        Names of all p standard parameters and joint terms.
    names : tuple of str
        (r,), the standard parameter that leads each base parameter.
    matrix : FloatArray
        M (r, p) of Φ_base = M Φ.
    values : FloatArray
        (r,).
    covariance : FloatArray or None
        (r, r).
    """

    robot: str
    model: str
    version: str
    rows: tuple[str, ...]
    joint_terms: JointTerms | None
    standard: ParameterSet
    names: tuple[str, ...]
    matrix: FloatArray
    values: FloatArray
    covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        r, p = len(self.names), len(self.standard)
        for name, shape in (("matrix", (r, p)), ("values", (r,)), ("covariance", (r, r))):
            given = getattr(self, name)
            if given is None:
                continue
            array = finite(given, name)
            if array.shape != shape:
                raise DataError(f"{name} must have shape {shape}, not {array.shape}")
            object.__setattr__(self, name, frozen(array))
        unknown = [name for name in self.names if name not in self.standard.labels]
        if unknown:
            raise DataError(f"{unknown[0]} leads a base parameter, but is no standard parameter")

    @classmethod
    @checked
    def of(
        cls, model: ForceModel, values: FloatArray, covariance: FloatArray | None = None
    ) -> BaseValues:
        """Values (r,) of the parameters of a force model, by choice with their covariance."""
        return cls(
            robot=model.mechanism.name,
            model=model.model,
            version=version("loopid"),
            rows=model.mechanism.independent,
            joint_terms=model.joint_terms,
            standard=model.base.parameters,
            names=model.base.names,
            matrix=model.base.matrix,
            values=values,
            covariance=covariance,
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each base parameter."""
        units = {parameter.label: parameter.unit for parameter in self.standard}
        return tuple(units[name] for name in self.names)

    @property
    def terms(self) -> tuple[dict[str, float], ...]:
        """For each base parameter its terms: the leading one, then those folded into it."""
        labels = self.standard.labels
        return tuple(
            {name: 1.0} | {labels[j]: float(row[j]) for j in np.flatnonzero(row)}
            for name, row in zip(self.names, self.matrix, strict=True)
        )

    @property
    def expressions(self) -> tuple[str, ...]:
        """Each base parameter as a readable sum."""
        return tuple(expression(terms) for terms in self.terms)

    @checked
    def regressor(
        self,
        mechanism: Mechanism,
        configurations: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
    ) -> FloatArray:
        """Forces (N, dof, r) per unit of each base parameter.

        Parameters
        ----------
        mechanism : Mechanism
            Whose parameters these are.
        configurations : FloatArray
            (N, nq), closed.
        velocities, accelerations : FloatArray
            (N, dof) of the independent coordinates.

        Raises
        ------
        DataError
            When the mechanism has other parameters or rows.
        """
        self._require(mechanism)
        motion = closed_motion(mechanism, configurations, velocities, accelerations)
        W = motion_regressor(mechanism, motion, self.model, self.joint_terms)
        labels = self.standard.labels
        return np.asarray(W[..., [labels.index(name) for name in self.names]], dtype=np.float64)

    def forces(
        self,
        mechanism: Mechanism,
        configurations: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
    ) -> FloatArray:
        """Forces (N, dof) of a motion; see ``regressor``."""
        W = self.regressor(mechanism, configurations, velocities, accelerations)
        return np.asarray(W @ self.values, dtype=np.float64)

    @checked
    def save(self, path: str | Path) -> Path:
        """Write to a .yaml, .yml, .json or .npz file, whole or not at all; its path.

        Raises
        ------
        OptionError
            When the name ends otherwise.
        OutputError
            When the file cannot be written.
        """
        write_file(path, _format(path).content(self, path))
        return Path(path)

    @classmethod
    @checked
    def load(cls, path: str | Path) -> BaseValues:
        """Read what was saved.

        Raises
        ------
        MissingFileError
            When there is no such file.
        DataError
            When it is none of these files, or damaged.
        """
        return cls(**_format(path).fields(path))

    def _require(self, mechanism: Mechanism) -> None:
        require_same(mechanism.path, "row", mechanism.independent, self.rows)
        own = motion_parameters(mechanism, self.model, self.joint_terms).labels
        require_same(mechanism.path, "parameter", own, self.standard.labels)


def require_same(source: object, what: str, own: Sequence[str], given: Sequence[str]) -> None:
    """Refuse names that differ from those of a robot.

    Raises
    ------
    DataError
        Naming the first one.
    """
    for one, other in zip_longest(own, given):
        if one != other:
            raise DataError(
                f"these are not the parameters of {source}: {what} {other or 'none'} is where it "
                f"has {one or 'none'}"
            )


def _format(path: str | Path) -> Any:
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise OptionError.unknown("ending", suffix or str(path), FORMATS)
    return FORMATS[suffix]
