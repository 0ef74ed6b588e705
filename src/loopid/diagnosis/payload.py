"""A payload from two runs, with and without it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import fdtrc, stdtrit

from loopid.arguments import FloatArray, checked, frozen
from loopid.base_parameters.base import BaseParameters, find_base
from loopid.diagnosis.gains import MotorNumbers, motor_scales
from loopid.diagnosis.loaded_runs import LoadedRuns, payload_columns
from loopid.errors import DataError, RankError
from loopid.findings import FALSE_ALARM, Finding
from loopid.identification.consistent import (
    BALL,
    CONSISTENT,
    error_weights,
    quiet_consistent_fit,
    solid_body,
)
from loopid.identification.correlation import within_runs
from loopid.identification.estimator import (
    Estimator,
    WorkingFit,
    chosen_estimator,
    result_of,
    solved,
)
from loopid.identification.fitting import working_fit
from loopid.identification.force_models import ForceModel
from loopid.identification.jackknife import with_scatter
from loopid.identification.problem import FitSamples
from loopid.identification.result import Fit, with_errors
from loopid.inertia import from_moments
from loopid.observation import Observation
from loopid.parameters import GRAVITY_KINDS, ParameterSet
from loopid.records import record
from loopid.robot.robot import Robot

PAYLOAD = "payload"
# Least relative error of a mass by a motor.
EXACT = 1e-6
# Degrees of freedom of what motors disagree by, at least: of two motors an interval of one degree
# would say nothing.
LEAST_KNOWN = 2


@record
class MotorMasses(MotorNumbers):
    """The mass of a payload in kg by each motor: what its gain would have to be right for."""

    def intervals(self, level: float = 0.95) -> FloatArray:
        """Confidence intervals (m, 2) in kg."""
        reach = stdtrit(self.degrees_of_freedom, 0.5 + level / 2)
        reach = reach * np.sqrt(np.diag(self.covariance))
        return np.stack([self.values - reach, self.values + reach], axis=1)

    @property
    def chance(self) -> float:
        """Probability that motors with right gains differ so much; 1 where there are not two."""
        if len(self.values) < 2:
            return 1.0
        square, count = self._square(0.0), len(self.values) - 1
        return float(fdtrc(count, max(self.degrees_of_freedom, 1), square / count))

    @property
    def spread(self) -> float:
        """Standard deviation in kg by which motors differ beyond their errors [Paule1982]."""
        from scipy.optimize import brentq  # slow to import

        count = len(self.values) - 1
        if count < 1 or self._square(0.0) <= count:
            return 0.0
        # The sum of squares falls with the spread; at this bound it is below its expectation.
        most = float(np.abs(self.values - self.values.mean()).max()) * 2 * np.sqrt(count + 1)
        return float(brentq(lambda s: self._square(s) - count, 0.0, most))

    def _square(self, spread: float) -> float:
        """Squared deviations from their best mean, in their errors and a spread beside these."""
        C = self.covariance + spread**2 * np.eye(len(self.values))
        inverse = np.linalg.inv(C)
        ones = np.ones(len(self.values))
        mean = (ones @ inverse @ self.values) / (ones @ inverse @ ones)
        return float((self.values - mean) @ inverse @ (self.values - mean))

    @property
    def disagreement(self) -> Finding | None:
        """That motors disagree, where they do."""
        if self.chance >= FALSE_ALARM:
            return None
        low, high = int(self.values.argmin()), int(self.values.argmax())
        return Finding(
            "warning",
            "motors disagree on the mass",
            f"{self.values[low]:.3g} kg by {self.actuators[low]}, {self.values[high]:.3g} kg by "
            f"{self.actuators[high]}: gains of drives are off, or the model lacks a force",
            "weigh it, and find the gains: "
            f"known_mass={np.median(self.values):.3g} (in Python: drive_gains)",
        )


@record
class PayloadFit:
    """What two runs say of a body that one of them carried.

    Attributes
    ----------
    link : str
        That the payload was fixed to; moments are about its origin, along its axes.
    base : BaseParameters
        Of the payload: which combinations of its parameters are identifiable.
    fit : Fit
        Of these combinations; its quality is that of robot and payload in all runs.
    standard_parameters : FloatArray
        (4,) or (10,), of the most likely solid body with these.
    motors : MotorMasses or None
        The mass by each motor; None where the forces do not determine it, or motors depend on each
        other.
    """

    link: str
    base: BaseParameters
    fit: Fit
    standard_parameters: FloatArray
    motors: MotorMasses | None = None

    @property
    def parameters(self) -> ParameterSet:
        """Leading parameter of each identifiable combination."""
        return self.fit.parameters

    @property
    def values(self) -> FloatArray:
        """Values (k,) of these."""
        return self.fit.values

    @property
    def covariance(self) -> FloatArray:
        """Their covariance (k, k)."""
        return self.fit.covariance

    def intervals(self, level: float = 0.95) -> FloatArray:
        """Their confidence intervals (k, 2), which hold what motors disagree by."""
        return self.fit.intervals(level)

    @property
    def mass(self) -> float:
        """Mass in kg.

        Raises
        ------
        RankError
            When it is identifiable only together with other parameters.
        """
        return float(self.values[self._alone()["m"]])

    def centre(self, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Centre of mass (3,) in the link's frame in m, and its confidence intervals (3, 2).

        To first order in the errors; NaN along axes where it is undetermined.

        Raises
        ------
        RankError
            When the mass is identifiable only together with other parameters.
        """
        alone, centre, reach = self._alone(), np.full(3, np.nan), np.full(3, np.nan)
        mass, freedom = self.mass, self.fit.degrees_of_freedom
        for axis, kind in enumerate(GRAVITY_KINDS[1:]):
            if kind in alone:
                rows = [alone["m"], alone[kind]]
                factor = stdtrit(freedom[rows].min(), 0.5 + level / 2)
                centre[axis] = self.values[rows[1]] / mass
                slope = np.array([-centre[axis], 1.0]) / mass
                reach[axis] = factor * np.sqrt(slope @ self.covariance[np.ix_(rows, rows)] @ slope)
        return frozen(centre), frozen(np.stack([centre - reach, centre + reach], axis=1))

    def _alone(self) -> dict[str, int]:
        """Rows, by kind, of parameters that are identifiable alone; the mass has to be one."""
        rows = _alone(self.base)
        if "m" not in rows:
            raise RankError(
                f"the forces do not determine the mass of a payload on {self.link} alone, but "
                f"{', '.join(self.base.expressions)}"
            )
        return rows

    def __repr__(self) -> str:
        rows = zip(
            *(self.base.expressions, self.values, self.parameters, self.intervals()), strict=True
        )
        lines = [
            f"  {name}: {value:.5g} {parameter.unit} [{low:.5g} ... {high:.5g}]"
            for name, value, parameter, (low, high) in rows
        ]
        return "\n".join([f"PayloadFit on {self.link}:", *lines[:9]])


@checked
def identify_payload(
    robot: Robot | ForceModel,
    unloaded: Any,
    loaded: Any,
    *,
    link: str,
    mapping: Any = None,
    estimator: Estimator | str = "wls",
) -> PayloadFit:
    """Identify a payload from runs without and with it, together with the robot's parameters.

    The runs share the robot: K Φ are its forces in all of them. In the loaded ones the payload adds
    the columns of the link that it is fixed to [Gautier2014]. No CAD is needed. The motions may
    differ, but have to excite the robot alike; the same motion is best.

    Delay, cut-off and joint terms are those that the runs without the payload ask for. By weighted
    least squares the robot file is weighed as in ``consistent_fit``. The payload is a solid body.
    Intervals hold what motors disagree by: each gain may be off by as much as they differ.

    Parameters
    ----------
    robot : Robot or ForceModel
        ``"gravity"`` determines mass and first moments, ``"full"`` inertias too. Of a robot it is
        the model that the data ask for.
    unloaded, loaded
        Of any form that ``identify`` takes.
    link : str
        A body of the robot.
    mapping : LogMapping or path, optional
        Which columns of paths and tables are what.
    estimator : Estimator or str
        As in ``fit``.

    Returns
    -------
    PayloadFit
        Mass in kg, first moments in kg m, inertias in kg m², in the link's frame, with
        intervals.

    Raises
    ------
    OptionError
        When the robot has no body of that name.
    RankError
        When the runs do not excite the payload's parameters, or no force depends on it.
    DataError
        When its mass comes out clearly negative.

    Warns
    -----
    DataWarning
        When motors clearly disagree on the mass.

    Examples
    --------
    A load of 2 kg on the coupler of a five-bar, 0.1 m along its x and 0.05 m along its y axis:

    >>> import loopid, numpy as np
    >>> robot = loopid.load("five_bar")
    >>> model = loopid.force_model(robot, "gravity", None)
    >>> plan = loopid.motion.read_motion_program("five_bar").motion("sweep", 20)
    >>> motion = loopid.motion.joint_motion(robot, plan)
    >>> load = np.zeros(robot.standard_parameters("full").size)
    >>> first = robot.parameters("full").labels.index("left_coupler.m")
    >>> load[first : first + 3] = 2.0, 0.2, 0.1
    >>> runs = []
    >>> for carried in (0.0, 1.0):
    ...     bodies = robot.standard_parameters("full") + carried * load
    ...     slow = loopid.motion.JointMotion(
    ...         motion.time, motion.configurations, 0 * motion.velocities,
    ...         0 * motion.accelerations, motion.singularity)
    ...     force = loopid.simulate(robot, slow, loopid.motion.Noise(gaussian=0.01),
    ...         seed=int(carried), standard_parameters=bodies).force
    ...     runs.append(loopid.logs.Recording.of_motion(slow, force, robot.actuated))
    >>> found = loopid.identify_payload(
    ...     model, unloaded=runs[0], loaded=runs[1], link="left_coupler"
    ... )
    >>> found.parameters.labels
    ('payload.m', 'payload.mx', 'payload.my')
    >>> found.values.round(1)
    array([2. , 0.2, 0.1])
    """
    chosen = chosen_estimator(estimator)
    runs = LoadedRuns.of(robot, link, (unloaded, loaded), mapping, estimator=chosen.name)
    model = runs.force_model
    regressor = model.random_regressor[:, :, payload_columns(model, link)]
    if not regressor.any():
        raise RankError(f"no force of a motor depends on a payload on {link}")
    names = ParameterSet.of_links([PAYLOAD], runs.kinds)
    base = find_base(Observation.from_matrix(regressor, names, length=model.robot.length))
    if chosen.name == "wls":
        runs, working = _with_the_file(runs, base)
    else:
        working = working_fit(_samples(runs, base), chosen)
    standard, result = _solid(runs, base, working.result)
    motors = _by_motor(runs, base, result, chosen)
    if motors is not None and motors.spread:
        result = _with_spread(runs, working, result, motors)
    found = PayloadFit(link, base, result, standard, motors)
    if motors is not None and motors.disagreement is not None:
        motors.disagreement.warn()
    return found


def _alone(base: BaseParameters) -> dict[str, int]:
    """Rows, by kind, of parameters that are identifiable alone."""
    kinds = zip(base.parameters.select(base.base), base.terms, strict=True)
    return {parameter.kind: k for k, (parameter, terms) in enumerate(kinds) if len(terms) == 1}


def _samples(runs: LoadedRuns, base: BaseParameters) -> FitSamples:
    """Robot and payload in all runs."""
    return runs.robot.beside(base.combinations, base.regressor(runs.carried))


def _with_the_file(runs: LoadedRuns, base: BaseParameters) -> tuple[LoadedRuns, WorkingFit]:
    """Robot and payload, with the robot file weighed as the runs without the payload ask for.

    And the runs, in which gears carry the payload, too.
    """
    robot = quiet_consistent_fit(runs.force_model, runs.unloaded, runs.noise)
    assert robot.prior is not None
    n, k = len(robot.result.values), len(base)
    rows = np.insert(robot.prior, np.full(k, n), 0.0, axis=1)
    weights, samples = robot.result.weights, _samples(runs, base)
    for _ in range(2):  # by the errors and loads of the robot alone, then by those of all
        values, R = solved(samples.problem, weights, rows)
        plain = result_of(CONSISTENT, samples.problem, values, R, weights, 1.0)
        working = within_runs(WorkingFit(plain, samples, rows))
        weights = error_weights(samples.problem, working.result.require_noise())
        load = np.zeros(len(runs.kinds))
        load[base.base] = values[n:]
        carrying = runs.carrying(load)
        samples = _samples(carrying, base)
    return carrying, with_scatter(working)


def _solid(runs: LoadedRuns, base: BaseParameters, result: Fit) -> tuple[FloatArray, Fit]:
    """Standard parameters of the payload as a solid body, and its fit given that it is one."""
    first, robot, alone = len(result.values) - len(base), runs.force_model.robot, _alone(base)
    x, C = result.values[first:], result.covariance[first:, first:]
    mass = float(robot.standard_parameters("full")[::10].mean()) or 1.0
    if "m" in alone:
        own, error = float(x[alone["m"]]), float(np.sqrt(C[alone["m"], alone["m"]]))
        freedom = result.degrees_of_freedom[first + alone["m"]]
        if own < stdtrit(freedom, FALSE_ALARM) * error:  # the nearest solid body weighs nothing
            raise DataError(
                f"the mass of the payload comes out negative, {own:.3g} ± {error:.2g} kg: the logs "
                "without and with it may be exchanged",
                value=own,
                standard_error=error,
            )
        mass = max(own, error)
    places = [alone.get(kind) for kind in GRAVITY_KINDS[1:]]
    centre = np.array([0.0 if k is None else x[k] / mass for k in places])
    guess = from_moments(mass, centre, mass * (BALL * robot.length) ** 2 / 5 * np.eye(3))
    standard, covariance = solid_body(x, C, base.matrix, guess)
    return standard, replace(
        result,
        parameters=base.combinations,
        values=base.matrix @ standard,
        covariance=covariance,
        degrees_of_freedom=result.degrees_of_freedom[first:],
        assumed=(),
        cutoff=runs.cutoff,
    )


def _by_motor(
    runs: LoadedRuns, base: BaseParameters, result: Fit, estimator: Estimator
) -> MotorMasses | None:
    """The mass by each motor, about that of a fit; None where this is not clear from zero."""
    row = _alone(base).get("m")
    if row is None or runs.force_model.robot.redundant:
        return None
    mass = float(result.values[row])
    if not result.intervals()[row, 0] > 0:
        return None
    known = np.full(len(runs.kinds), np.nan)
    known[runs.kinds.index("m")] = mass
    found = motor_scales(runs, known, estimator)
    least = EXACT**2 * np.eye(len(found.values))
    numbers = mass * found.values, mass**2 * (found.covariance + least), found.degrees_of_freedom
    return MotorMasses(found.actuators, *numbers, found.undetermined)


def _with_spread(runs: LoadedRuns, working: WorkingFit, result: Fit, motors: MotorMasses) -> Fit:
    """The fit with intervals that hold what motors disagree by."""
    samples, bodies = working.samples, np.array(working.result.values)
    bodies[runs.force_model.joint_columns] = 0.0
    of_motors = np.isin(samples.actuators, motors.actuators)
    forces = samples.predicted(bodies)[:, :, None] * np.eye(len(of_motors))[:, of_motors]
    part = motors.spread / float(np.average(motors.values))
    known = max(len(motors.values) - 1, LEAST_KNOWN)
    return with_errors(result, part * working.response(forces)[-len(result.values) :], known)
