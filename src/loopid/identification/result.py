"""What a fit found, how far to trust it, and how well it explains the forces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, fields, replace
from difflib import SequenceMatcher
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from loopid.arguments import FloatArray, IntArray, Number, checked, finite, frozen, variances
from loopid.errors import DataError, OptionError
from loopid.identification.problem import FitProblem
from loopid.numbers import number
from loopid.parameters import ParameterSet, html_table
from loopid.records import Tabular, record
from loopid.registry import fit_exports

if TYPE_CHECKING:
    from loopid.identification.force_models import ForceModel
    from loopid.identification.prediction import Prediction
    from loopid.robot.robot import Robot

# Squared deviation of a force from its mean, relative to its square, that is but round-off.
CONSTANT_FORCE = 1e-12
# Fewer degrees of freedom determine no interval.
LEAST_FREEDOM = 1.0
# Lines of a ``repr`` that list parameters.
LISTED = 7
VALUES = "values"  # estimator of values that nothing was fitted to


class OfArrays:
    """Lists, as files have them, become arrays."""

    def __post_init__(self) -> None:
        kinds = {"FloatArray": np.float64, "IntArray": np.int64, "FloatArray | None": np.float64}
        for each in fields(self):  # type: ignore[arg-type]
            given = getattr(self, each.name)
            if each.type in kinds and given is not None:
                object.__setattr__(self, each.name, frozen(given, kinds[each.type]))


@record
class Quality(OfArrays):
    """Residuals of parameters on data, by actuator; NaN where it has no samples."""

    residual_rms: FloatArray  # (dof,) in N or N m
    # (dof,), 1 - residual over total squares about the mean; negative when worse than the mean, NaN
    # for a constant force
    r_squared: FloatArray
    samples: IntArray  # (dof,)

    @classmethod
    def of(cls, problem: FitProblem, squares: FloatArray) -> Quality:
        """Of sums of squared residuals (dof,) of a problem."""
        force = problem.force_squares()
        total = force - problem.samples * problem.mean_force**2
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(problem.samples > 0, squares / problem.samples, np.nan)
            r_squared = np.where(total > CONSTANT_FORCE * force, 1.0 - squares / total, np.nan)
        return cls(np.sqrt(mean), r_squared, problem.samples)


@checked
def fit_quality(problem: FitProblem, values: FloatArray) -> Quality:
    """Residuals of a problem at parameter values (n,)."""
    phi, width = finite(values, "values"), len(problem.parameters)
    if phi.shape != (width,):
        raise DataError(f"values must have shape ({width},), not {phi.shape}")
    return Quality.of(problem, problem.residual_squares(phi))


@record
class NoiseModel(OfArrays):
    """An autoregressive model of each actuator's errors, e_t = Σ c_k e_{t-k} + ε_t.

    Actuators without samples have NaN for all that is not a count.
    """

    actuators: tuple[str, ...]
    # (dof, order), c_k, padded with zeros; order 0 when the errors of all are independent
    coefficients: FloatArray
    innovation: FloatArray  # (dof,), standard deviation of ε in N or N m
    deviation: FloatArray  # (dof,), standard deviation of e in N or N m
    lag_one: FloatArray  # (dof,), correlation of neighbouring errors
    samples: IntArray  # (dof,)
    # (dof,), number of independent samples that would determine a mean as well; at most ``samples``
    effective_samples: FloatArray


@record
class Robustness(OfArrays):
    """Scale and weights of the residuals of a robust fit, by actuator; NaN without samples."""

    # (dof,) in N or N m, standard deviation of errors without outliers, from the median
    scale: FloatArray
    # (dof,), share of the samples that count less than half: some 1 % of normal errors
    down_weighted: FloatArray


# Deviations of the robot file as a whole that the data may choose, in parts of its bodies, and the
# largest of a single one. The least is 0.4: evidence averages ten parameters, and a wrong mass
# spoils one.
LEAST_OFF, LARGEST_OFF, LARGEST_OF_BODY = 0.4, 1.0, 3.0


@record
class FileDeviation(OfArrays):
    """How far the bodies of the robot file are off, as the data say, in parts of themselves."""

    common: float  # of all bodies
    bodies: tuple[str, ...]  # those with a mass
    own: FloatArray  # (bodies,), of each: larger for one that is far off while the others are right

    @property
    def sentence(self) -> str:
        """How far the file is trusted; at a bound that is no finding of the data."""
        bound = not LEAST_OFF < self.common < LARGEST_OFF
        off = (f"{name} {number(100 * own, 2)} %" for name, own in self.rows if own > self.common)
        also = ", ".join(off)
        return (
            f"the given bodies {'are assumed' if bound else 'count as'} right to "
            f"{number(100 * self.common, 2)} %{f', but {also}' if also else ''}"
        )

    @property
    def far(self) -> tuple[str, ...]:
        """Bodies that are as far off as they may be."""
        return tuple(self.bodies[k] for k in np.flatnonzero(self.own >= LARGEST_OF_BODY))

    @property
    def rows(self) -> list[tuple[str, float]]:
        """Each body with its deviation."""
        return list(zip(self.bodies, self.own.tolist(), strict=True))

    @property
    def fault(self) -> str:
        """What a deviation at its bound says: a sentence, empty where none is."""
        if self.common < LARGEST_OFF and not self.far:
            return ""
        who = f"bodies {', '.join(self.far)}" if self.far else "the bodies"
        most = LARGEST_OF_BODY if self.far else LARGEST_OFF
        return (
            f"{who} would have to be off the robot file by {most:g} times themselves: it is of "
            "another robot (a tool, a payload), or the model lacks a force"
        )


@record
class TermDeviations(OfArrays):
    """Prior deviations of groups of joint terms, as the evidence of the data chooses them."""

    names: tuple[str, ...]  # of the groups, such as ``"elbow: friction curve"``
    own: FloatArray  # (g,), deviation of each, in the unit of its terms
    determined: FloatArray  # (g,), how many of its terms the data determine
    # (g,), logarithm of how much likelier the data are with the group than without it
    evidence: FloatArray


@record
class MotorUse(OfArrays):
    """How the motors were used in the samples of a fit."""

    joints: tuple[str, ...]
    slowest: FloatArray  # (m,), slowest informative and fastest rate of each, in m/s or rad/s
    fastest: FloatArray
    load: FloatArray  # (m,), mean size of the force that moved the bodies, in N or N m
    largest: FloatArray  # (m,), largest size of the force, in N or N m

    @property
    def columns(self) -> tuple[tuple[str, ...], list[float], list[float]]:
        """Joints, slowest and fastest rates."""
        return self.joints, self.slowest.tolist(), self.fastest.tolist()

    def of(self, joint: str) -> tuple[float, float]:
        """Slowest and fastest rate of a joint."""
        k = self.joints.index(joint)
        return float(self.slowest[k]), float(self.fastest[k])


@record
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
        """Standard error in % of the value; infinite for a value of zero."""
        return 100 * self.standard_error / abs(self.value) if self.value else np.inf

    def __str__(self) -> str:
        low, high = self.interval
        if not self.standard_error and np.isinf(high):
            return f"{self.name}: {self.value:.5g} {self.unit}".rstrip() + ", assumed"
        return (
            f"{self.name}: {self.value:.5g} ± {self.standard_error:.2g} {self.unit}".rstrip()
            + f" ({self.relative_std:.1f} %), 95 %: {low:.5g} to {high:.5g}"
        )


# Part of the file's variance that the data must take away for a value to count as theirs.
DETERMINED = 0.5


@record
class StandardUncertainty(OfArrays):
    """What the covariance of a fit, and the robot file, say of the p standard parameters."""

    parameters: ParameterSet  # the standard parameters of the bodies, and the joint terms
    gain: FloatArray  # (p, n), changes of these with the n base parameters
    beside: FloatArray  # (p,), variances at known base parameters
    file: FloatArray  # (p,), variances by the robot file alone; 0 for what no force depends on
    degrees_of_freedom: FloatArray  # (p,)


@record(checked=True)
class Fit(OfArrays, Tabular):
    """Estimated parameters with their uncertainty, found by their names or sums.

    A combination, of which forces determine the sum alone, is called ``<leading parameter> + 3
    more``; ``parameters.expressions`` are the sums.

    Attributes
    ----------
    estimator : str
    parameters : ParameterSet
    actuators : tuple of str
    values : FloatArray
        (n,).
    covariance : FloatArray
        (n, n), for the errors of ``noise``, or independent ones where that is None.
    condition_number : float
        Of the weighted regressor.
    degrees_of_freedom : FloatArray
        (n,), of Student's distribution, or one number for all: rows less parameters, fewer where
        errors are correlated or estimates vary between recordings.
    quality : Quality
        On the data that were fitted.
    weights : FloatArray
        (dof,), of the actuators' residuals; 0 without samples.
    noise : NoiseModel or None
        Autocorrelation of the errors.
    assumed : tuple of str
        Names of parameters that the data alone do not determine, whose values rest on assumptions:
        their intervals are infinite.
    robustness : Robustness or None
        Scales and weights of a robust fit.
    standard_parameters : FloatArray or None
        (p,), standard parameters and joint terms whose base parameters the values are, every body
        solid; None for estimators that find base parameters only.
    uncertainty : StandardUncertainty or None
        Of the standard parameters.
    deviation : FileDeviation or None
        Of the robot file, where the fit weighs it.
    cutoff : float or None
        In Hz, of the filter, where it was chosen by predictions.
    term_deviations : TermDeviations or None
        Of groups of joint terms, where there are any.
    use : MotorUse or None
        Rates and loads of the motors in the data; None where they are not known.
    model : ForceModel or None
        Whose parameters these are, its gears loaded by these values; None for parameters that were
        fitted to samples alone (``ForceModel.fit_of``).
    settled : bool
        Whether the solver reached the best values, where it takes steps.
    mistakes : tuple of str
        In the logs that were fitted, one sentence each: no value counts before they are mended.
    unseen_rms : FloatArray or None
        (dof,), root mean square errors on data that were not fitted, in N or N m; NaN without any.
    broken : tuple of str
        Laws of sane fits that it breaks on these logs (``absurdities``), one sentence each.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.m", "arm.mx"])
    >>> rng = np.random.default_rng(0)
    >>> W = rng.normal(size=(500, 1, 2))
    >>> force = W @ [2.0, 0.5] + 0.1 * rng.normal(size=(500, 1))
    >>> samples = loopid.identification.FitSamples.of(names, ["motor"], W, force)
    >>> found = loopid.identification.fit(samples)
    >>> round(found["arm.m"].value, 1), found["arm.m"].unit
    (2.0, 'kg')
    >>> low, high = found.intervals(0.999).T
    >>> bool(((low < [2.0, 0.5]) & ([2.0, 0.5] < high)).all())
    True
    >>> found.forces(W).shape
    (500, 1)
    """

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
    unseen_rms: FloatArray | None = None
    broken: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        freedom = np.broadcast_to(self.degrees_of_freedom, self.values.shape)
        object.__setattr__(self, "degrees_of_freedom", frozen(freedom))
        for name in self.assumed:
            if name not in self.parameters.names:
                raise OptionError.unknown("assumed parameter", name, self.parameters.names)
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
        """The force model.

        Raises
        ------
        OptionError
            Where it is not known.
        """
        if self.model is None:
            raise OptionError(
                "the fit does not know its force model: give it one, fit = model.fit_of(fit)"
            )
        return self.model

    @property
    def robot(self) -> Robot:
        """The robot of the force model."""
        return self.require_model().robot

    @property
    def standard_errors(self) -> FloatArray:
        """Standard deviations (n,) of the estimates."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)

    @property
    def relative_std(self) -> FloatArray:
        """Standard errors (n,) in % of the estimates; infinite for an estimate of zero."""
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

    def model_for(self, robot: Robot | ForceModel, *, anyway: bool = False) -> ForceModel:
        """The force model of the values, for a robot or its force model; ``Dynamics`` takes it.

        Raises
        ------
        OptionError
            When the fit breaks a law of sane ones (``absurdities``), and is not taken anyway.
        DataError
            When the robot is another one.
        """
        from loopid.identification.saved import on_robot  # stands on this

        return on_robot(self, robot, anyway=anyway)

    def __getitem__(self, name: str) -> Estimate:
        names, sums = self.parameters.names, self.parameters.expressions
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

        Empty for fits of base parameters alone. Of what only the robot file gives the interval is
        by how far off the file is.
        """
        from scipy.special import stdtrit  # here, as it takes a while to import

        known, values = self.uncertainty, self.standard_parameters
        if known is None or values is None:
            return {}
        variance = known.beside + variances(known.gain, self.covariance)
        errors = np.sqrt(variance)
        freedom = np.minimum(known.degrees_of_freedom, self.degrees_of_freedom.min())
        reach = stdtrit(freedom, 0.975) * errors
        determined = variance < (1 - DETERMINED) * known.file
        numbers = (values, errors, values - reach, values + reach, determined)
        rows = zip(known.parameters, *(each.tolist() for each in numbers), strict=True)
        return {
            p.label: Estimate(value, error, (low, high), p.unit, p.label, determined=of_data)
            for p, value, error, low, high, of_data in rows
        }

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of a table, one a parameter."""
        return [
            {"parameter": e.name, "value": e.value, "standard_error": e.standard_error}
            | {"low": e.interval[0], "high": e.interval[1], "unit": e.unit}
            | {"expression": e.expression or e.name}
            for e in self.estimates
        ]

    def _table(self) -> list[dict[str, Any]]:
        return self.rows

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

    # What it predicts, and what it becomes.

    @overload
    def predict(self, data: list[Any] | tuple[Any, ...]) -> tuple[Prediction, ...]: ...
    @overload
    def predict(self, data: Any) -> Prediction: ...
    def predict(self, data: Any) -> Prediction | tuple[Prediction, ...]:
        """Forces of data beside what the fit gives for their motion.

        Parameters
        ----------
        data
            A path, a table, a ``Log`` or a ``Recording`` of the fit's robot; or a list of these.
            Where a filter leaves the cut-off open, it is that of the fit.

        Returns
        -------
        Prediction, or a tuple of them for a list

        Raises
        ------
        OptionError
            When the fit does not know its force model, or the data are nothing of that.
        DataError
            When the data are of other motors than the fit.

        Examples
        --------
        >>> import loopid
        >>> model = loopid.force_model(loopid.load("five_bar"), "full", None)
        >>> model.fit_of(model.prior).predict("urdf/logs/five_bar.csv").predicted.shape[1]
        2
        """
        from loopid.identification.prediction import predictions  # stands on this

        found = predictions(self, data)
        return found if isinstance(data, list | tuple) else found[0]

    def require_bodies(self) -> FloatArray:
        """Standard parameters and joint terms (p,), which a robot file can be made of.

        Raises
        ------
        DataError
            When the fit is of base parameters only.
        """
        if self.standard_parameters is None:
            raise DataError(
                f"a fit by {self.estimator} has base parameters, which are those of many bodies: "
                "identify with the default estimator, whose recommended fit has bodies"
            )
        return self.standard_parameters

    def save(self, path: str | Path, *, anyway: bool = False) -> Path:
        """Write a file with all that it takes to use the fit, for ``load_fit``.

        Parameters
        ----------
        path : path
            Ending in .yaml, .yml or .json; written whole or not at all.
        anyway : bool
            Whether a fit that breaks a law of sane ones (``absurdities``) is written.

        Raises
        ------
        OptionError
            When the name ends otherwise, the force model is not known, or the fit breaks a law.
        FileError
            When the file cannot be written, or is one of the robot's.

        Examples
        --------
        >>> import loopid, tempfile
        >>> model = loopid.force_model(loopid.load("five_bar"), joint_terms=None)
        >>> fit = model.fit_of(model.prior)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     fit.save(f"{folder}/fit.json").name
        'fit.json'
        """
        from loopid.identification.saved import save  # stands on this

        return save(self, path, anyway=anyway)

    def record(self) -> dict[str, Any]:
        """All of it in plain numbers, lists and texts, as it stands in its file."""
        from loopid.identification.saved import FitFile  # stands on this

        return FitFile.of(self).record()

    def to_robot_file(
        self, path: str | Path, *, overwrite: bool = False, anyway: bool = False
    ) -> Path:
        """Write the robot's own file with these bodies and joint terms; all else in it stays.

        Parameters
        ----------
        path : path
            Ending as the robot's own file does.
        overwrite : bool
            Whether the robot's own file may be replaced.
        anyway : bool
            Whether a fit is written that is not fit for use: of a log with a mistake, or one that
            breaks a law of sane ones.

        Raises
        ------
        DataError
            When the fit has base parameters only.
        OptionError, FileError
            As ``save``.

        Warns
        -----
        ModelWarning
            Of joint terms that the file has no place for.
        """
        found: Path = fit_exports["robot file"](self, path, overwrite=overwrite, anyway=anyway)
        return found

    def to_c(
        self, folder: str | Path, *, name: str | None = None, anyway: bool = False
    ) -> list[Path]:
        """Write C source for a controller that knows its motors only, with these values.

        Parameters
        ----------
        folder : path
            Made where it is missing.
        name : str, optional
            A C identifier that all names begin with; by default made of the robot's.
        anyway : bool
            As of ``to_robot_file``.

        Returns
        -------
        list of Path
            Of the header, of the source, and of the same for CasADi.

        Raises
        ------
        MissingExtraError
            When CasADi is not installed.
        OptionError, FileError
            As ``save``, and when a joint has no symbolic form.
        """
        found: list[Path] = fit_exports["C source"](self, folder, name=name, anyway=anyway)
        return found

    def to_pinocchio(self, *, anyway: bool = False) -> tuple[Any, Any]:
        """Pinocchio's model of the open tree with these bodies, and its closures' constraints.

        They are what ``pinocchio.constraintDynamics`` takes. Rotor inertias, viscous and Coulomb
        friction are in ``armature``, ``damping`` and ``friction``.

        Parameters
        ----------
        anyway : bool
            As of ``to_robot_file``.

        Raises
        ------
        DataError
            When the fit has base parameters only.
        OptionError
            Naming a closure that Pinocchio has no contact for, or a law that the fit breaks.
        """
        found: tuple[Any, Any] = fit_exports["Pinocchio"](self, anyway=anyway)
        return found

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


def of_all(found: Fit, parameters: ParameterSet, columns: IntArray, others: FloatArray) -> Fit:
    """A fit of some columns of all n parameters, the others ``assumed`` at values (n,)."""
    names = parameters.names
    known = {names[j] for j in columns} - {*found.assumed}
    values, covariance = np.array(others), np.zeros((len(names), len(names)))
    values[columns], covariance[np.ix_(columns, columns)] = found.values, found.covariance
    freedom = np.full(len(names), found.degrees_of_freedom.min())
    freedom[columns] = found.degrees_of_freedom
    return replace(
        found,
        parameters=parameters,
        values=values,
        covariance=covariance,
        degrees_of_freedom=freedom,
        assumed=tuple(name for name in names if name not in known),
    )


def with_errors(fit: Fit, moved: FloatArray, known: float) -> Fit:
    """A fit with further errors: values move by columns (n, k) times numbers of unit variance.

    Their size is known to this many degrees of freedom, which add up as in [Welch1947].
    """
    added, own = (moved**2).sum(axis=1), np.diag(fit.covariance)
    with np.errstate(divide="ignore", invalid="ignore"):
        together = (own + added) ** 2 / (own**2 / fit.degrees_of_freedom + added**2 / known)
    return replace(
        fit,
        covariance=fit.covariance + moved @ moved.T,
        degrees_of_freedom=np.where(added > 0, together, fit.degrees_of_freedom),
    )


def relative_deviation(errors: FloatArray, values: FloatArray) -> FloatArray:
    """Standard errors (n,) in % of values (n,); infinite for a value of zero."""
    relative = np.full(len(values), np.inf)
    np.divide(100 * errors, np.abs(values), out=relative, where=values != 0)
    return relative
