"""A fit: estimates with all that they predict and become."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, overload

import numpy as np

from loopid.arguments import FloatArray, checked, finite
from loopid.errors import DataError
from loopid.files import require_ending, require_other_file, write_file
from loopid.identification.data import recordings_of, require_some
from loopid.identification.estimates import Estimates
from loopid.identification.force_models import ForceModel
from loopid.identification.plausibility import require_fit_for_use, require_sane
from loopid.identification.prediction import Prediction, predicted
from loopid.identification.quality import Quality
from loopid.identification.saved import ENDINGS, FitFile, as_file
from loopid.loading.files import own_files
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.registry import fit_exports
from loopid.robot.robot import Robot

RECOMMENDED = "parameters.yaml"  # in the folder of ``loopid identify --out``
VALUES = "values"  # estimator of values that nothing was fitted to


@record(checked="outside")
class Fit(Estimates):
    """Estimated parameters with their uncertainty, found by their names or sums.

    A combination, of which forces determine the sum alone, is called ``<leading parameter> + 3
    more``. ``parameters.expressions`` are the sums.

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
        fitted to samples alone (``Fit.of``).
    settled : bool
        Whether the solver reached the best values, where it takes steps.
    mistakes : tuple of str
        In the logs that were fitted, one sentence each: no value counts before they are mended.
    turning : tuple of str
        Joints whose friction brakes at low speed and drives at high speed, or turned, as all
        parameters clearly say: a drive adds forces that are recorded.
    unseen_rms : FloatArray or None
        (dof,), root mean square errors on data that were not fitted, in N or N m; NaN without any.
    broken : tuple of str
        Laws of sane fits that it breaks on these logs (``absurdities``), one sentence each.
    ripples : Ripples or None
        Waves of forces over positions of motors, which estimates are beside.
    unexplained : tuple of str
        The force whose errors on new data are too large for any use, in a sentence, if any.
    offset_errors : FloatArray or None
        (n, k), what offsets that were left out may move the estimates by; intervals of these hold
        it beside the covariance.

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

    @classmethod
    def of(cls, force_model: ForceModel, fit: Fit | FloatArray) -> Fit:
        """A fit of the parameters of a force model, which it then knows.

        Parameters
        ----------
        force_model : ForceModel
        fit : Fit or FloatArray
            Of these parameters; or values (n,), which have no errors.

        Raises
        ------
        DataError
            When the fit is not one of these parameters, or has standard parameters of others.

        Examples
        --------
        >>> import loopid
        >>> model = loopid.force_model(loopid.load("five_bar"), joint_terms=None)
        >>> fit = loopid.Fit.of(model, 2 * model.prior)  # twice the bodies of the robot file
        >>> round(fit["left_crank.mx + 2 more"].value, 3)
        0.999
        """
        if isinstance(fit, Fit):
            return replace(fit, model=force_model)
        values, motors = finite(fit, "values"), force_model.robot.independent
        unknown = np.full(len(motors), np.nan)
        return cls(
            estimator=VALUES,
            parameters=force_model.parameters,
            actuators=motors,
            values=values,
            covariance=np.zeros(2 * values.shape),
            condition_number=np.nan,
            degrees_of_freedom=np.zeros(values.shape),
            quality=Quality(unknown, unknown, np.zeros(len(motors), dtype=np.int64)),
            weights=np.zeros(len(motors)),
            assumed=force_model.parameters.names,
            model=force_model,
        )

    def model_for(self, robot: Robot | ForceModel, *, anyway: bool = False) -> ForceModel:
        """The force model of the values, for a robot or its force model; ``Dynamics`` takes it.

        The robot is the fit's, or has other inertials alone. A fit that breaks a law of sane ones
        (``absurdities``) is taken ``anyway``, or not at all.
        """
        fit, own = self, robot if isinstance(robot, Robot) else robot.robot
        if self.model is None and isinstance(robot, ForceModel):
            fit = replace(self, model=robot)
        require_sane(fit, anyway)
        if fit.robot != own:
            fit = replace(fit, model=FitFile.of(fit).model_of(own))
        return fit.require_model()

    # What it predicts, and what it becomes.

    @overload
    def predict(
        self, data: list[Any] | tuple[Any, ...], *, mapping: Any = None
    ) -> tuple[Prediction, ...]: ...
    @overload
    def predict(self, data: Any, *, mapping: Any = None) -> Prediction: ...
    def predict(self, data: Any, *, mapping: Any = None) -> Prediction | tuple[Prediction, ...]:
        """Forces of data beside what the fit gives for their motion.

        Parameters
        ----------
        data
            A path, a table, a ``Log`` or a ``Recording`` of the fit's robot; or a list of these.
            Where a filter leaves the cut-off open, it is that of the fit, or what the rate allows.
        mapping : LogMapping or path, optional
            Which columns of paths and tables are what, as of ``identify``.

        Returns
        -------
        Prediction, or a tuple of them for a list

        Raises
        ------
        OptionError
            When the fit does not know its force model, or the data are nothing of that, or none.
        DataError
            When the data are of other motors than the fit.

        Examples
        --------
        >>> import loopid
        >>> model = loopid.force_model(loopid.load("five_bar"), "full", None)
        >>> loopid.Fit.of(model, model.prior).predict("urdf/logs/five_bar.csv").predicted.shape[1]
        2
        """
        require_some(data)
        (runs,) = recordings_of(self.robot, data, mapping=mapping)
        found = tuple(predicted(self, each) for each in runs)
        return found if isinstance(data, list | tuple) else found[0]

    def require_bodies(self) -> FloatArray:
        """Standard parameters and joint terms (p,), which a robot file can be made of."""
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
            Whether a fit is written that breaks a law of sane ones (``absurdities``). One that is
            not fit for use by its errors, or by a mistake of its log, is written: the file says so.

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
        >>> fit = loopid.Fit.of(model, model.prior)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     fit.save(f"{folder}/fit.json").name
        'fit.json'
        """
        text = self.content(path, anyway=anyway)
        require_other_file(path, *own_files(self.robot))
        write_file(path, text)
        return Path(path)

    def content(self, path: str | Path, *, anyway: bool = False) -> str:
        """What ``save`` writes to a file of that name."""
        require_ending(path, ENDINGS)
        require_sane(self, anyway)
        return as_file(self.record())

    def record(self) -> dict[str, Any]:
        """All of it in plain numbers, lists and texts, as it stands in its file."""
        return FitFile.of(self).content

    def to_robot_file(
        self, path: str | Path, *, overwrite: bool = False, anyway: bool = False
    ) -> Path:
        """Write the robot's own file with these bodies and joint terms; all else in it stays.

        Closures, motors and a reference that ``load`` was given in Python stand in a YAML beside
        the file, of the same name.

        Parameters
        ----------
        path : path
            Ending as the robot's own file does.
        overwrite : bool
            Whether the robot's own file, or another YAML, may be replaced.
        anyway : bool
            Whether a fit is written that is not fit for use: of a log with a mistake, one that
            breaks a law of sane ones, that leaves a force unexplained, or whose friction drives.

        Returns
        -------
        Path
            What ``load`` takes: the YAML where there is one.

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
        require_fit_for_use(self, anyway)
        model, bodies = self.require_model(), self.require_bodies()
        what = {"parameters": model.base.parameters, "use": self.use}
        export = fit_exports["robot file"]
        found: Path = export(model.robot, bodies, path, overwrite=overwrite, **what)
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
        require_fit_for_use(self, anyway)
        source = fit_exports["C source"](self.require_model(), name=name, values=self.values)
        found: list[Path] = source.save(folder)
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
            Naming a closure that Pinocchio has no contact for; when the fit is not fit for use.
        """
        require_fit_for_use(self, anyway)
        model, bodies = self.require_model(), self.require_bodies()
        found: tuple[Any, Any] = fit_exports["Pinocchio"](model, bodies, self.use)
        return found


def fit_file(path: str | Path) -> Path:
    """The file of a saved fit, given itself or as the folder of ``loopid identify --out``."""
    place = Path(path)
    return place / RECOMMENDED if place.is_dir() else place


@checked
def load_fit(path: str | Path, robot: Robot | str | Path | None = None) -> Fit:
    """Read a fit that ``Fit.save`` wrote, the same to the bit, with its force model.

    Parameters
    ----------
    path : path
        Ending in .yaml, .yml or .json; or a folder of ``loopid identify --out``.
    robot : Robot or path, optional
        The robot, or its file; by default from where it was, loaded as it was.

    Returns
    -------
    Fit
        With its force model.

    Raises
    ------
    FileError
        When there is no such file, or the robot is no longer where it was.
    DataError
        When it is no saved fit, or was changed; when the robot is another one.
    OptionError
        When the name ends otherwise.

    Examples
    --------
    >>> import loopid, tempfile
    >>> model = loopid.force_model(loopid.load("five_bar"), joint_terms=None)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = loopid.Fit.of(model, 1.1 * model.prior).save(f"{folder}/fit.yaml")
    ...     fit = loopid.load_fit(path)
    >>> fit.robot.name, fit.parameters == model.parameters
    ('five_bar', True)
    """
    file = FitFile.read(fit_file(path))
    own = robot if isinstance(robot, Robot) else file.load_robot(robot)
    return file.fit(Fit, file.model_of(own))


def of_all(found: Fit, parameters: ParameterSet, others: FloatArray | None = None) -> Fit:
    """A fit of some of n parameters as one of all, others ``assumed`` at values (n,) or zero."""
    if found.parameters == parameters:
        return found
    names, known = parameters.names, {*found.parameters.names} - {*found.assumed}
    columns = [parameters.labels.index(label) for label in found.parameters.labels]
    values = np.zeros(len(names)) if others is None else np.array(others)
    covariance = np.zeros((len(names), len(names)))
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
