"""A payload from two runs, with and without it; drive gains from a payload that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace

import numpy as np
from scipy.special import stdtrit

from loopid.arguments import FloatArray, checked, finite, frozen, row_blocks
from loopid.base_parameters.base import BaseParameters, find_base_parameters
from loopid.errors import DataError, OptionError, RankError
from loopid.identification.cutoff import choose_cutoff, prepared_at
from loopid.identification.estimator import Estimator, chosen_estimator
from loopid.identification.fitting import fit, quiet_fit
from loopid.identification.force_model import ForceModel
from loopid.identification.problem import FitSamples
from loopid.identification.result import FitResult
from loopid.logs.recording import Recording
from loopid.observation import Observation
from loopid.parameters import GRAVITY_KINDS, KINDS, Parameter, ParameterSet
from loopid.records import record

PAYLOAD = "payload"
# Relative change of the gains at which they have converged, and after how many steps at most.
CONVERGED, MOST_STEPS = 1e-9, 50


@record
class PayloadFit:
    """What two runs say of a body that one of them carried.

    Attributes
    ----------
    link : str
        That the payload was fixed to; moments are about its origin, along its axes.
    base : BaseParameters
        Of the payload: which combinations of its parameters can be told from the forces.
    fit : FitResult
        Of the robot's base parameters and, after them, those of the payload.
    """

    link: str
    base: BaseParameters
    fit: FitResult

    @property
    def parameters(self) -> ParameterSet:
        """Leading parameter of each combination that can be told."""
        return self.fit.parameters.select(range(self._first, len(self.fit.values)))

    @property
    def values(self) -> FloatArray:
        """Values (k,) of these."""
        return self.fit.values[self._first :]

    @property
    def covariance(self) -> FloatArray:
        """Their covariance (k, k)."""
        return self.fit.covariance[self._first :, self._first :]

    def intervals(self, level: float = 0.95) -> FloatArray:
        """Their confidence intervals (k, 2)."""
        return self.fit.intervals(level)[self._first :]

    @property
    def _first(self) -> int:
        return len(self.fit.values) - len(self.base)

    @property
    def mass(self) -> float:
        """Mass in kg.

        Raises
        ------
        RankError
            When the forces tell it only together with other parameters.
        """
        return float(self.values[self._alone()["m"]])

    def centre(self, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Centre of mass (3,) in the link's frame in m, and its confidence intervals (3, 2).

        To first order in the errors; NaN along axes that the forces do not tell.

        Raises
        ------
        RankError
            When the forces tell the mass only together with other parameters.
        """
        alone, centre, reach = self._alone(), np.full(3, np.nan), np.full(3, np.nan)
        mass, factor = self.mass, stdtrit(self.fit.degrees_of_freedom.min(), 0.5 + level / 2)
        for axis, kind in enumerate(GRAVITY_KINDS[1:]):
            if kind in alone:
                rows = [alone["m"], alone[kind]]
                centre[axis] = self.values[rows[1]] / mass
                slope = np.array([-centre[axis], 1.0]) / mass
                reach[axis] = factor * np.sqrt(slope @ self.covariance[np.ix_(rows, rows)] @ slope)
        return frozen(centre), frozen(np.stack([centre - reach, centre + reach], axis=1))

    def _alone(self) -> dict[str, int]:
        """Rows, by kind, of parameters that are told alone; the mass has to be one."""
        terms = enumerate(self.base.terms)
        rows = {self.parameters[k].kind: k for k, each in terms if len(each) == 1}
        if "m" not in rows:
            raise RankError(
                f"the forces do not tell the mass of a payload on {self.link} alone: they tell "
                f"{', '.join(self.base.expressions)}"
            )
        return rows

    def __repr__(self) -> str:
        told = zip(
            *(self.base.expressions, self.values, self.parameters, self.intervals()), strict=True
        )
        lines = [
            f"  {name}: {value:.5g} {parameter.unit} [{low:.5g} ... {high:.5g}]"
            for name, value, parameter, (low, high) in told
        ]
        return "\n".join([f"PayloadFit on {self.link}:", *lines[:9]])


@record
class GainFit:
    """Drive gains: what a motor's true force is for each unit of the logged one.

    Attributes
    ----------
    actuators : tuple of str
    gains : FloatArray
        (dof,); multiply ``force_scale`` of the log's mapping by them.
    covariance : FloatArray
        (dof, dof).
    degrees_of_freedom : float
        Of the intervals.
    values : FloatArray
        (n,) base parameters of the force model without the payload, in true units.
    """

    actuators: tuple[str, ...]
    gains: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float
    values: FloatArray

    def intervals(self, level: float = 0.95) -> FloatArray:
        """Confidence intervals (dof, 2) of the gains."""
        reach = stdtrit(self.degrees_of_freedom, 0.5 + level / 2)
        reach = reach * np.sqrt(np.diag(self.covariance))
        return np.stack([self.gains - reach, self.gains + reach], axis=1)

    def __repr__(self) -> str:
        told = zip(self.actuators, self.gains, self.intervals(), strict=True)
        lines = [f"  {n}: {gain:.4f} [{low:.4f} ... {high:.4f}]" for n, gain, (low, high) in told]
        return "\n".join(["GainFit, true force over logged force:", *lines[:9]])


@checked
def identify_payload(
    force_model: ForceModel,
    link: str,
    *,
    unloaded: Sequence[Recording],
    loaded: Sequence[Recording],
    estimator: Estimator | str = "wls",
) -> PayloadFit:
    """Identify a payload from runs without and with it, together with the robot's parameters.

    The runs share the robot: K Φ are its forces in all of them, and in the loaded ones the
    payload adds the columns of the link that it is fixed to [Gautier2014]. No CAD is needed. The
    motions may differ, but have to excite the robot alike; the same motion is best.

    Parameters
    ----------
    force_model : ForceModel
        ``"gravity"`` tells mass and first moments, ``"full"`` inertias too.
    link : str
        A body of the robot.
    unloaded, loaded : sequence of Recording
    estimator : Estimator or str
        As in ``fit``.

    Raises
    ------
    OptionError
        When the robot has no body of that name.
    RankError
        When the runs do not excite the robot's parameters, or no force depends on the payload.

    Examples
    --------
    A load of 2 kg on the coupler of a five-bar, 0.1 m along its x and 0.05 m along its y axis:

    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> model = loopid.find_force_model(robot, "gravity", None)
    >>> plan = loopid.read_motion_program("five_bar").motion("sweep", 20)
    >>> motion = loopid.joint_motion(robot, plan)
    >>> load = np.zeros(robot.standard_parameters("full").size)
    >>> first = robot.parameters("full").labels.index("left_coupler.m")
    >>> load[first : first + 3] = 2.0, 0.2, 0.1
    >>> runs = []
    >>> for carried in (0.0, 1.0):
    ...     bodies = robot.standard_parameters("full") + carried * load
    ...     slow = loopid.motion.JointMotion(
    ...         motion.time, motion.configurations, 0 * motion.velocities,
    ...         0 * motion.accelerations, motion.singularity)
    ...     force = loopid.simulate_measurement(robot, slow, loopid.Noise(gaussian=0.01),
    ...         seed=int(carried), standard_parameters=bodies).force
    ...     runs.append(loopid.logs.Recording.of_motion(slow, force, robot.actuated))
    >>> found = loopid.identify_payload(
    ...     model, "left_coupler", unloaded=[runs[0]], loaded=[runs[1]]
    ... )
    >>> found.parameters.labels
    ('payload.m', 'payload.mx', 'payload.my')
    >>> found.values.round(1)
    array([2. , 0.2, 0.1])
    """
    if not unloaded or not loaded:
        raise DataError("a payload takes recordings without it, and others with it")
    unloaded, loaded = _at_best_cutoff(force_model, unloaded, loaded)
    columns = _link_columns(force_model, link)
    regressor = force_model.random_regressor[:, :, columns]
    if not regressor.any():
        raise RankError(f"no force of a motor depends on a payload on {link}")
    names = ParameterSet.of_links([PAYLOAD], [force_model.base.parameters[j].kind for j in columns])
    observation = Observation.from_matrix(regressor, names, length=force_model.mechanism.length)
    base, parts = find_base_parameters(observation), []
    for carried, run in [*((0.0, run) for run in unloaded), *((1.0, run) for run in loaded)]:
        samples = force_model.samples(run)
        added = carried * base.regressor(_link_regressor(force_model, run, columns))
        W = np.concatenate([samples.regressor, added], axis=2)
        every = force_model.parameters + base.parameters.select(base.base)
        parts.append(replace(samples, parameters=every, regressor=W))
    return PayloadFit(link, base, fit(FitSamples.combined(parts), estimator))


@record(checked=True)
class KnownLoad:
    """A body that is known.

    Attributes
    ----------
    mass : float
        In kg.
    centre : FloatArray
        (3,), its centre of mass in the link's frame in m; by default the origin.
    inertia : FloatArray
        (3, 3) about its centre of mass, along the link's axes, in kg m²; by default a point mass.

    Raises
    ------
    OptionError
        When the mass is not above 0, or an array has another shape.
    """

    mass: float
    centre: FloatArray = field(default_factory=lambda: np.zeros(3))
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        if not 0 < self.mass < np.inf:
            raise OptionError(f"the known mass must be above 0 kg, not {self.mass}")
        for name, shape in (("centre", (3,)), ("inertia", (3, 3))):
            array = finite(getattr(self, name), name)
            if array.shape != shape:
                raise OptionError(f"{name} must have shape {shape}, not {array.shape}")
            object.__setattr__(self, name, array)

    @property
    def parameters(self) -> FloatArray:
        """Standard parameters (10,), in Pinocchio's order, about the link's origin."""
        c = self.centre
        about = self.inertia + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        products = about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        return np.concatenate([[self.mass], self.mass * c, products])


@checked
def drive_gains(
    force_model: ForceModel,
    link: str,
    load: KnownLoad,
    *,
    unloaded: Sequence[Recording],
    loaded: Sequence[Recording],
    estimator: Estimator | str = "wls",
) -> GainFit:
    """Find the gains of drives from runs without and with a known mass.

    What is logged is c = τ / g for each motor. The known mass puts newtons into the equations, so
    robot and gains are found together [Gautier2014]: c = s ∘ (K Φ + K_L δ) with s = 1/g is solved
    by Gauss-Newton steps. Errors of the log stay errors of c alone, which total least squares
    would spread over the columns.

    Parameters
    ----------
    force_model : ForceModel
    link : str
        That the known mass was fixed to.
    load : KnownLoad
    unloaded, loaded : sequence of Recording
    estimator : Estimator or str
        As in ``fit``.

    Raises
    ------
    OptionError
        When the robot has no body of that name.
    RankError
        When the runs do not excite the robot's parameters.
    DataError
        When the known mass acts on no force of some motor, or the gains do not converge.

    Examples
    --------
    See ``identify_payload``; with ``KnownLoad(2.0, [0.1, 0.05, 0.0])`` the gains of that robot are
    1.

    >>> import loopid
    >>> loopid.diagnosis.KnownLoad(-2.0)
    Traceback (most recent call last):
        ...
    loopid.errors.OptionError: the known mass must be above 0 kg, not -2.0
    """
    if not unloaded or not loaded:
        raise DataError("drive gains take recordings without the known mass, and others with it")
    known = load.parameters
    unloaded, loaded = _at_best_cutoff(force_model, unloaded, loaded)
    columns = _link_columns(force_model, link)
    samples = FitSamples.combined([force_model.samples(run) for run in [*unloaded, *loaded]])
    added = [np.zeros_like(run.force) for run in unloaded]
    added += [_link_regressor(force_model, run, columns) @ known[: len(columns)] for run in loaded]
    W, n, dof = samples.regressor, len(force_model.parameters), len(samples.actuators)
    extra = np.concatenate(added)
    names = force_model.parameters + ParameterSet(
        tuple(Parameter(actuator, "scale", "1") for actuator in samples.actuators)
    )
    if not extra.any(axis=0).all():
        motor = samples.actuators[int(np.flatnonzero(~extra.any(axis=0))[0])]
        raise DataError(f"no force of {motor} depends on a mass on {link}: its gain stays unknown")
    values, scales, chosen = np.zeros(n), np.ones(dof), chosen_estimator(estimator)
    for _ in range(MOST_STEPS):
        rigid = samples.predicted(values) + extra
        slopes = np.concatenate([scales[:, None] * W, rigid[:, :, None] * np.eye(dof)], axis=2)
        # c ≈ s₀ (K Φ + K_L δ) + (s - s₀) (K Φ₀ + K_L δ), linear in Φ and s.
        target = samples.force + scales * (rigid - extra)
        data = FitSamples.of(
            names,
            samples.actuators,
            slopes,
            target,
            used=samples.used,
            stretches=samples.stretches,
        )
        step = quiet_fit(data, chosen)
        change = np.abs(step.values[n:] / scales - 1).max()
        values, scales = step.values[:n], step.values[n:]
        if (scales <= 0).any():
            motor = samples.actuators[int(np.flatnonzero(scales <= 0)[0])]
            raise DataError(
                f"the gain of {motor} comes out negative: is its force_scale negative, or is the "
                f"mass on {link} not in the runs that are said to carry it?"
            )
        if change <= CONVERGED:
            spread = step.covariance[n:, n:] / np.outer(scales**2, scales**2)
            freedom = float(step.degrees_of_freedom.min())
            return GainFit(samples.actuators, 1 / scales, spread, freedom, values)
    raise DataError(f"the gains still change by {change:.1e} after {MOST_STEPS} steps")


def _at_best_cutoff(
    force_model: ForceModel, unloaded: Sequence[Recording], loaded: Sequence[Recording]
) -> tuple[Sequence[Recording], Sequence[Recording]]:
    """Recordings at the cut-off that predicts those without the payload best."""
    choice = choose_cutoff(force_model, unloaded)
    if choice is None:
        return unloaded, loaded
    choice.warn()
    return (
        prepared_at(force_model, unloaded, choice.chosen),
        prepared_at(force_model, loaded, choice.chosen),
    )


def _link_columns(force_model: ForceModel, link: str) -> list[int]:
    """Columns of a body among the p standard parameters."""
    parameters = force_model.base.parameters
    columns = [j for j, p in enumerate(parameters) if p.link == link and p.kind in KINDS]
    if not columns:
        bodies = dict.fromkeys(p.link for p in parameters if p.kind in KINDS)
        raise OptionError.unknown("body", link, list(bodies))
    return columns


def _link_regressor(force_model: ForceModel, run: Recording, columns: list[int]) -> FloatArray:
    """Forces (N, dof, k) per unit of each parameter of the link."""
    motion = run.motion
    blocks = (
        force_model.standard_regressor(
            motion.configurations[rows], motion.velocities[rows], motion.accelerations[rows]
        )[:, :, columns]
        for rows in row_blocks(len(run))
    )
    return np.concatenate(list(blocks))
