"""Gains of drives, by what a load of known mass does to the force of each motor.

What is logged of motor i is c_i = s_i (K_i Φ + L_i δ) + errors. K Φ are the forces of the robot. L
δ are those of the load in the runs that carry it. Both are in newtons. The gain of the motor is
g_i = 1 / s_i. The known mass is part of δ. All that is not known of Φ, δ and s is found together
[Gautier2014] by Gauss-Newton steps. The currents, which are noisy, stand on the left alone. On the
right they would be columns of a least squares for g_i. Their noise would make all gains too small.

Read the other way round, known gains determine the mass. With any other mass, s is as many times as
large. So m s_i is the mass by motor i alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.special import stdtrit

from loopid.arguments import BoolArray, FloatArray, Positive, checked, finite
from loopid.diagnosis.loaded_runs import LoadedRuns
from loopid.errors import DataError, OptionError, RankError
from loopid.identification.estimator import (
    LEAST_EXCITATION,
    Estimator,
    chosen_estimator,
    excited_combinations,
)
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_models import ForceModel
from loopid.identification.problem import FitSamples
from loopid.identification.result import Fit
from loopid.logs.mapping import LogMapping, mapping_of
from loopid.parameters import KINDS, ParameterSet
from loopid.records import record
from loopid.robot.robot import Robot

# Relative change of the scales at which steps end, how many there are at most, and the change at
# which scales count as found after these.
CONVERGED, MOST_STEPS, SETTLED = 1e-9, 50, 1e-6
# Part of a motor's scale in what no force depends on, from which its gain is undetermined.
INVOLVED = 1e-3
# Half of a gain's 95 % interval, in parts of it, from which it is undetermined.
WIDEST = 0.5


@record(checked=True)
class KnownLoad:
    """A body of which the mass is known, and the centre and inertia may be.

    Attributes
    ----------
    mass : float
        In kg.
    centre : FloatArray or None
        (3,), its centre of mass in the link's frame in m; None where it is not known.
    inertia : FloatArray or None
        (3, 3) about its centre of mass, along the link's axes, in kg m²; None where it is not
        known.

    Raises
    ------
    OptionError
        When the mass is not above 0, an array has another shape, or an inertia has no centre.

    Examples
    --------
    >>> import loopid
    >>> load = loopid.diagnosis.KnownLoad(2.8, centre=[0, 0, 0.05])
    >>> load.mass, load.centre.tolist()
    (2.8, [0.0, 0.0, 0.05])
    """

    mass: Positive
    centre: FloatArray | None = None
    inertia: FloatArray | None = None

    def __post_init__(self) -> None:
        for name, shape in (("centre", (3,)), ("inertia", (3, 3))):
            if getattr(self, name) is None:
                continue
            array = finite(getattr(self, name), name)
            if array.shape != shape:
                raise OptionError(f"{name} must have shape {shape}, not {array.shape}")
            object.__setattr__(self, name, array)
        if self.inertia is not None and self.centre is None:
            raise OptionError("an inertia is about the centre of mass: give the centre, too")

    @property
    def parameters(self) -> FloatArray:
        """Standard parameters (10,) about the link's origin; NaN where they are not known."""
        known = np.full(len(KINDS), np.nan)
        known[0] = self.mass
        if (c := self.centre) is not None:
            known[1:4] = self.mass * c
            if self.inertia is not None:
                known[:] = pin.Inertia(self.mass, c, self.inertia).toDynamicParameters()
        return known


@record
class GainFit:
    """Drive gains: what a motor's true force is for each unit of the logged one.

    Attributes
    ----------
    actuators : tuple of str
        The m motors whose gains are determined.
    gains : FloatArray
        (m,); multiply ``force_scale`` of the log's mapping by them.
    covariance : FloatArray
        (m, m).
    degrees_of_freedom : float
        Of the intervals.
    undetermined : tuple of str
        Motors whose gains are undetermined: their forces do not depend on robot and load, or
        hardly.
    force_scales : tuple of mapping
        Of each log, see ``Log``; empty where there is none.
    """

    actuators: tuple[str, ...]
    gains: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float
    undetermined: tuple[str, ...] = ()
    force_scales: tuple[Mapping[str, float], ...] = ()

    def intervals(self, level: float = 0.95) -> FloatArray:
        """Confidence intervals (m, 2) of the gains.

        Errors are those of the inverse, the scale of the logged force, which ends are found of.
        """
        reach = stdtrit(self.degrees_of_freedom, 0.5 + level / 2)
        part = reach * np.sqrt(np.diag(self.covariance)) / self.gains
        ends = np.stack([1 + part, np.maximum(1 - part, 0)], axis=1)
        with np.errstate(divide="ignore"):
            return np.asarray(self.gains[:, None] / ends)

    def mapping(self, mapping: LogMapping | str | Path | None = None) -> LogMapping:
        """The mapping by which the logs are read with these gains.

        Its ``content`` is that of a mapping file. Motors whose gains are undetermined keep them.

        Parameters
        ----------
        mapping : LogMapping or path, optional
            By which they were read.

        Raises
        ------
        DataError
            When a log is not of a file.
        OptionError
            When forces of the logs are in different units, or motors move joints together.
        """
        if not all(self.force_scales):
            raise DataError("a mapping is of logs from files, which recordings of motions have not")
        gains = dict(zip(self.actuators, self.gains.tolist(), strict=True))
        return mapping_of(mapping).with_gains(gains, self.force_scales)

    def __repr__(self) -> str:
        rows = zip(self.actuators, self.gains, self.intervals(), strict=True)
        lines = [f"  {n}: {gain:.4f} [{low:.4f} ... {high:.4f}]" for n, gain, (low, high) in rows]
        lines += [f"  {name}: undetermined" for name in self.undetermined]
        return "\n".join(["GainFit, true force over logged force:", *lines[:9]])


@checked
def drive_gains(
    robot: Robot | ForceModel,
    unloaded: Any,
    loaded: Any,
    *,
    link: str,
    load: KnownLoad,
    mapping: Any = None,
    estimator: Estimator | str = "wls",
) -> GainFit:
    """Find the gains of drives from runs without and with a load of known mass.

    Gains, robot and what is not known of the load are one estimate. Motors that do not
    determine their gains are named, and left out of it.

    Parameters
    ----------
    robot : Robot or ForceModel
        Of a robot it is the model that the data ask for.
    unloaded, loaded
        Of any form that ``identify`` takes.
    link : str
        That the load was fixed to.
    load : KnownLoad
        Its mass is enough; its centre and inertia, where they are known, make gains surer.
    mapping : LogMapping or path, optional
        Which columns of paths and tables are what.
    estimator : Estimator or str
        As in ``fit``.

    Returns
    -------
    GainFit
        True forces over logged ones, of each motor with a determined gain.

    Raises
    ------
    OptionError
        When the robot has no body of that name, or motors that depend on each other.
    RankError
        When no gain is determined.
    DataError
        When a gain is negative.

    Examples
    --------
    See ``identify_payload``; with ``KnownLoad(2.0)`` the gains of that robot are 1.

    >>> import loopid
    >>> loopid.diagnosis.KnownLoad(-2.0)
    Traceback (most recent call last):
        ...
    loopid.errors.OptionError: mass must be above 0, not -2.0
    """
    own = robot if isinstance(robot, Robot) else robot.robot
    if own.redundant:
        raise OptionError(
            "gains take motors that do not depend on each other: "
            f"{', '.join(own.redundant)} follow from the others",
            motors=own.redundant,
        )
    name = chosen_estimator(estimator).name
    runs = LoadedRuns.of(robot, link, (unloaded, loaded), mapping, estimator=name)
    found = motor_scales(runs, load.parameters[: len(runs.kinds)], estimator)
    if not found.actuators:
        known, advice = ("mass", ": give its centre") if load.centre is None else ("load", "")
        raise RankError(f"no force of a motor shows what the known {known} on {link} does{advice}")
    s = found.values
    covariance = found.covariance / np.outer(s**2, s**2)
    others = found.degrees_of_freedom, found.undetermined, runs.force_scales
    return GainFit(found.actuators, 1 / s, covariance, *others)


@record
class MotorNumbers:
    """A number of each motor that determines it."""

    actuators: tuple[str, ...]  # these m motors
    values: FloatArray  # (m,)
    covariance: FloatArray  # (m, m)
    degrees_of_freedom: float
    undetermined: tuple[str, ...]  # the other motors


def motor_scales(
    runs: LoadedRuns, known: FloatArray, estimator: Estimator | str = "wls"
) -> MotorNumbers:
    """What is logged of motors, in parts of their forces by robot and load.

    With some parameters (k,) of the load known, NaN for the others. A scale below 0 is refused.
    """
    chosen, names = chosen_estimator(estimator), np.array(runs.robot.actuators, dtype=object)
    driven, free = ~np.isin(names, runs.force_model.robot.free), np.isnan(known)
    added = ParameterSet.of_links(["load"], np.array(runs.kinds)[free].tolist())
    given = runs.carried[:, :, ~free] @ known[~free]
    every = excited_combinations(runs.robot.beside(added, runs.carried[:, :, free]))
    telling = _telling(every, given, driven, chosen)
    while telling.any():
        kept = every.used & (telling | ~driven)
        rows = excited_combinations(replace(every, used=kept))
        scales, last = _converged(rows, given, telling, chosen)
        m = int(telling.sum())
        found = scales[telling]
        part = np.ptp(last.intervals()[-m:], axis=1) / 2 / np.abs(found)
        if part.max() < WIDEST and np.allclose(last.values[-m:], found, rtol=SETTLED):
            break
        telling[np.flatnonzero(telling)[part.argmax()]] = False  # the least sure one
    undetermined = tuple(names[driven & ~telling].tolist())
    if not telling.any():
        return MotorNumbers((), np.zeros(0), np.zeros((0, 0)), 1.0, undetermined)
    if (found < 0).any():
        motor = names[telling][found.argmin()]
        raise DataError(
            f"the gain of {motor} comes out negative: is its force_scale negative, or is the load "
            "not in the runs that are said to carry it?",
            motor=motor,
        )
    covariance, freedom = last.covariance[-m:, -m:], float(last.degrees_of_freedom.min())
    return MotorNumbers(tuple(names[telling].tolist()), found, covariance, freedom, undetermined)


# What is logged is s ∘ (X φ + given): X the regressor of samples, φ what is not known of robot and
# load, and given forces (N, dof) of what is.


def _about(
    samples: FitSamples,
    given: FloatArray,
    values: FloatArray,
    scales: FloatArray,
    telling: BoolArray,
) -> FitSamples:
    """Linear in the parameters and, after them, the scales of motors that determine theirs."""
    rigid = samples.predicted(values) + given
    # c = s₀ (X φ + given) + (s - s₀) (X φ₀ + given)
    target = samples.force + scales * (np.where(telling, rigid, 0.0) - given)
    columns = rigid[:, :, None] * np.eye(len(scales))[:, telling]
    names = np.array(samples.actuators, dtype=object)[telling].tolist()
    scaled = replace(samples, regressor=scales[:, None] * samples.regressor)
    return scaled.with_force(target).beside(ParameterSet.of_links(names, ["scale"]), columns)


def _telling(
    samples: FitSamples, given: FloatArray, driven: BoolArray, estimator: Estimator
) -> BoolArray:
    """Motors (dof,) whose scales change the forces as nothing else does."""
    values, count = estimator.fit_samples(samples.less(given)).result.values, int(driven.sum())
    problem = _about(samples, given, values, np.ones(len(driven)), driven).problem
    R = problem.weighted(problem.force_weights)[:-1, :-1][:, -count:]
    sizes = np.linalg.norm(R, axis=0)
    _, spectrum, right = np.linalg.svd(R[-count:] / np.where(sizes > 0, sizes, 1.0))
    found, hidden = np.array(driven), right[spectrum < LEAST_EXCITATION]
    found[driven] = np.linalg.norm(hidden, axis=0) < INVOLVED
    return found


def _converged(
    samples: FitSamples, given: FloatArray, telling: BoolArray, estimator: Estimator
) -> tuple[FloatArray, Fit]:
    """Scales (dof,) after steps until these change nothing, and the fit of a further one."""
    values = estimator.fit_samples(samples.less(given)).result.values
    scales, n = np.ones(len(telling)), len(values)
    for _ in range(MOST_STEPS):
        rows = _about(samples, given, values, scales, telling)
        found = estimator.fit_samples(rows).result.values
        change = float(np.abs(found[n:] / scales[telling] - 1).max())
        values, scales = found[:n], np.array(scales)
        scales[telling] = found[n:]
        if change <= CONVERGED:
            break
    return scales, quiet_fit(_about(samples, given, values, scales, telling), estimator)
