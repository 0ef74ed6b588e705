"""Estimated parameters with their uncertainty, found by their names or sums."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from difflib import SequenceMatcher
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, Number, finite, frozen, variances
from loopid.errors import DataError, OptionError
from loopid.identification.force_models import ForceModel
from loopid.identification.quality import (
    FileDeviation,
    MotorUse,
    NoiseModel,
    Quality,
    Ripples,
    Robustness,
    StandardUncertainty,
    TermDeviations,
)
from loopid.parameters import ParameterSet, html_table
from loopid.records import Tabular, record
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.robot import Robot

# Fewer degrees of freedom determine no interval.
LEAST_FREEDOM = 1.0
# Lines of a ``repr`` that list parameters.
LISTED = 7
# Part of the file's variance that the data must take away for a value to count as theirs.
DETERMINED = 0.5
# Standard error in % of a value from which on the value is the round-off of zero.
NO_VALUE = 1e9


@record(checked="outside")
class Estimate:
    """All numbers about one parameter.

    Attributes
    ----------
    value, standard_error : float
    interval : tuple of float
        Of 95 %; infinite where the data determine none.
    unit : str
    name : str
        A combination is ``<leading parameter> + 3 more``.
    expression : str
        The whole sum.
    determined : bool
        Whether the data determine it; otherwise only the robot file does.

    Examples
    --------
    >>> import loopid
    >>> found = loopid.identify(loopid.load("five_bar"), "urdf/logs/five_bar.csv")
    >>> coulomb = found.fit["left_crank_joint.Fc"]
    >>> coulomb.unit, coulomb.interval[0] < 0.1 < coulomb.interval[1]
    ('N m', True)
    """

    value: float
    standard_error: float
    interval: tuple[float, float]
    unit: str
    name: str
    expression: str = ""
    determined: bool = True

    @property
    def relative_std(self) -> float:
        """Standard error in % of the value; infinite for a value that is zero but for round-off."""
        errors, values = np.array([self.standard_error]), np.array([self.value])
        return float(relative_deviation(errors, values)[0])

    def __str__(self) -> str:
        low, high = self.interval
        if not self.standard_error and np.isinf(high):
            return f"{self.name}: {self.value:.5g} {self.unit}".rstrip() + ", assumed"
        relative = f" ({self.relative_std:.1f} %)" if np.isfinite(self.relative_std) else ""
        return (
            f"{self.name}: {self.value:.5g} ± {self.standard_error:.2g} {self.unit}".rstrip()
            + f"{relative}, 95 %: {low:.5g} to {high:.5g}"
        )


@record(checked="outside")
class Estimates(Tabular):
    """What a ``Fit`` knows; there, what each attribute is, and what it becomes."""

    estimator: str
    parameters: ParameterSet
    actuators: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    condition_number: Number
    degrees_of_freedom: FloatArray
    quality: Quality
    weights: FloatArray
    noise: NoiseModel | None = None
    assumed: tuple[str, ...] = ()
    robustness: Robustness | None = None
    standard_parameters: FloatArray | None = None
    uncertainty: StandardUncertainty | None = None
    deviation: FileDeviation | None = None
    cutoff: float | None = None
    term_deviations: TermDeviations | None = None
    use: MotorUse | None = None
    model: ForceModel | None = field(default=None, compare=False, repr=False)
    settled: bool = True
    mistakes: tuple[str, ...] = ()
    turning: tuple[str, ...] = ()
    unseen_rms: FloatArray | None = None
    broken: tuple[str, ...] = ()
    unexplained: tuple[str, ...] = ()
    ripples: Ripples | None = None
    offset_errors: FloatArray | None = None

    def __post_init__(self) -> None:
        shape, freedoms = self.values.shape, self.degrees_of_freedom.shape
        if len(shape) != 1 or freedoms not in (shape, ()):
            raise DataError(
                f"a fit has values (n,), and degrees_of_freedom (n,) or one, not {shape} and "
                f"{freedoms}"
            )
        freedom = np.broadcast_to(self.degrees_of_freedom, shape)
        object.__setattr__(self, "degrees_of_freedom", frozen(freedom))
        for name in self.assumed:
            OptionError.require("assumed parameter", name, self.parameters.names)
        model = self.model
        if model is None:
            return
        if self.parameters != model.parameters or self.values.shape != (len(model.base),):
            raise DataError(
                f"a fit of {len(self.parameters)} parameters with values {self.values.shape} is "
                f"none of the {len(model.base)} base parameters of the force model"
            )
        loaded = model.with_loads(self.values, self.standard_parameters)
        object.__setattr__(self, "model", loaded)

    def require_model(self) -> ForceModel:
        """The force model; an OptionError where it is not known."""
        if self.model is None:
            raise OptionError(
                "the fit does not know its force model: give it one, fit = Fit.of(model, fit)"
            )
        return self.model

    def require_noise(self) -> NoiseModel:
        """The model of the errors; a DataError where there is none, as of values alone."""
        if self.noise is None:
            raise DataError("the fit has no model of its errors: take one by fit(samples)")
        return self.noise

    @property
    def robot(self) -> Robot:
        """The robot of the force model."""
        return self.require_model().robot

    @property
    def joint_terms(self) -> JointTerms:
        """Those of the force model, none where it is not known or has none."""
        return (None if self.model is None else self.model.joint_terms) or JointTerms(())

    def rates_of(self, joint: str) -> tuple[float, float] | None:
        """Slowest and fastest rate of a joint in the data; None where they are not known."""
        return self.use.of(joint) if self.use is not None and joint in self.use.joints else None

    @property
    def standard_errors(self) -> FloatArray:
        """Standard deviations (n,) of the estimates."""
        squares = np.maximum(np.diag(self.covariance), 0.0)  # of exact values they are round-off
        if self.offset_errors is not None:
            squares = squares + np.square(self.offset_errors).sum(axis=1)
        return np.asarray(np.sqrt(squares), dtype=np.float64)

    @property
    def relative_std(self) -> FloatArray:
        """Standard errors (n,) in % of the estimates; infinite for one of zero."""
        return relative_deviation(self.standard_errors, self.values)

    def intervals(self, level: float = 0.95) -> FloatArray:
        """Confidence intervals (n, 2) at a level between 0 and 1, by Student's distribution.

        Infinite where fewer than one degree of freedom is left, and for parameters that are
        assumed.
        """
        from scipy.special import stdtrit  # here, as it takes a while to import

        if not 0 < level < 1:
            raise OptionError(f"level must be between 0 and 1, not {level}")
        reach = stdtrit(self.degrees_of_freedom, 0.5 + level / 2) * self.standard_errors
        reach[self.degrees_of_freedom < LEAST_FREEDOM] = np.inf
        reach[[name in self.assumed for name in self.parameters.names]] = np.inf
        return np.stack([self.values - reach, self.values + reach], axis=1)

    def __getitem__(self, name: str) -> Estimate:
        names, sums = self.parameters.names, self.parameters.expressions
        if not isinstance(name, str):
            raise OptionError(f"a value is asked for by its name, not by {name!r}", given=name)
        if name in sums:
            return self.estimates[sums.index(name)]
        if name in names:
            return self.estimates[names.index(name)]
        with_it = [one.name for one in self.parameters if name in (one.label, *one.others)]
        if with_it:
            alone = f'; of the robot, it is fit.standard["{name}"]'
            of_robot = alone if name in self.standard else ""
            raise OptionError(
                f"the data determine no {name} alone, but in sums: ask for "
                f"{' or '.join(with_it)}{of_robot}",
                given=name,
                valid=tuple(with_it),
            )
        near = sorted(self.parameters, key=lambda p: -SequenceMatcher(None, name, p.label).ratio())
        raise OptionError.unknown("parameter", name, [each.name for each in near])

    def __iter__(self) -> Iterator[str]:
        return iter(self.parameters.names)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """All numbers about each parameter."""
        columns = self.values.tolist(), self.standard_errors.tolist(), self.intervals().tolist()
        none = {*self.assumed}
        return tuple(
            Estimate(value, error, (low, high), p.unit, p.name, p.expression, p.name not in none)
            for p, value, error, (low, high) in zip(self.parameters, *columns, strict=True)
        )

    @property
    def standard(self) -> dict[str, Estimate]:
        """Masses, first moments, inertias and joint terms of the robot, by their labels.

        Empty for fits of base parameters alone, or without a force model. Of what only the robot
        file gives the interval is by how far off the file is.
        """
        from scipy.special import stdtrit  # here, as it takes a while to import

        known, values, model = self.uncertainty, self.standard_parameters, self.model
        if known is None or values is None or model is None:
            return {}
        variance = known.beside + variances(known.gain, self.covariance)
        if self.offset_errors is not None:
            variance = variance + np.square(known.gain @ self.offset_errors).sum(axis=1)
        errors = np.sqrt(variance)
        freedom = np.minimum(known.degrees_of_freedom, self.degrees_of_freedom.min())
        # One that is a parameter of the fit itself has its interval there.
        own = dict(zip(self.parameters.names, self.degrees_of_freedom, strict=True))
        labels = model.base.parameters.labels
        freedom = np.array([own.get(label, n) for label, n in zip(labels, freedom, strict=True)])
        reach = stdtrit(freedom, 0.975) * errors
        determined = variance < (1 - DETERMINED) * known.file
        numbers = (values, errors, values - reach, values + reach, determined)
        rows = zip(model.base.parameters, *(each.tolist() for each in numbers), strict=True)
        return {
            p.label: Estimate(value, error, (low, high), p.unit, p.label, determined=of_data)
            for p, value, error, low, high, of_data in rows
        }

    def _table(self) -> list[dict[str, Any]]:
        return [
            {"parameter": e.name, "value": e.value, "standard_error": e.standard_error}
            | {"low": e.interval[0], "high": e.interval[1], "unit": e.unit}
            | {"expression": e.expression or e.name}
            for e in self.estimates
        ]

    def insignificant(self) -> tuple[str, ...]:
        """Names of the parameters whose 95 % interval includes zero."""
        low, high = self.intervals().T
        return tuple(self.parameters.names[j] for j in np.flatnonzero((low <= 0) & (high >= 0)))

    def forces(self, regressor: FloatArray) -> FloatArray:
        """Forces (..., dof) of a regressor (..., dof, n)."""
        W = finite(regressor, "regressor")
        dof, n = len(self.actuators), len(self.parameters)
        if W.shape[-2:] != (dof, n):
            raise DataError(f"the regressor must have shape (..., {dof}, {n}), not {W.shape}")
        return np.asarray(W @ self.values, dtype=np.float64)

    def __str__(self) -> str:
        return "\n".join(str(estimate) for estimate in self.estimates)

    def __repr__(self) -> str:
        more = len(self.values) - LISTED
        lines = [
            f"Fit by {self.estimator!r}: {len(self.values)} parameters from "
            f"{int(self.quality.samples.sum())} forces of {len(self.actuators)} actuators, "
            f"condition number {self.condition_number:.4g}",
            *map(str, self.estimates[:LISTED]),
            *([f"... and {more} more: print() lists all"] if more > 0 else []),
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head = ("parameter", "value", "standard error", "unit", "% std", "95 % from", "to")
        rows = [
            (e.name, e.value, e.standard_error, e.unit, e.relative_std, *e.interval)
            for e in self.estimates
        ]
        return html_table(head, rows)


def relative_deviation(errors: FloatArray, values: FloatArray) -> FloatArray:
    """Standard errors (n,) in % of values (n,); infinite for one that is zero but for round-off.

    A bound of zero leaves values such as 1e-20 or 0, which are one and the same.
    """
    relative = np.full(len(values), np.inf)
    held = np.abs(values) > 100 * errors / NO_VALUE
    np.divide(100 * errors, np.abs(values), out=relative, where=held)
    return relative
