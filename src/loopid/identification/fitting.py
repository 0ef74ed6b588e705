"""From samples to parameters: one experiment, or two in steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from loopid.arguments import NOT_EMPTY, checked
from loopid.errors import DataWarning, OptionError, warn
from loopid.identification.correlation import within_runs
from loopid.identification.estimates import LEAST_FREEDOM
from loopid.identification.estimator import Estimator, WorkingFit, chosen_estimator
from loopid.identification.jackknife import with_scatter
from loopid.identification.problem import FitSamples
from loopid.identification.quality import fit_quality
from loopid.identification.result import Fit


@checked
def fit(
    samples: FitSamples,
    estimator: str | Estimator = "wls",
) -> Fit:
    """Estimate parameters, with intervals that allow for autocorrelated residuals.

    Of three recordings or more, intervals also hold what differs between these, such as friction.

    Parameters
    ----------
    samples : FitSamples
    estimator : str or Estimator
        A name of ``ESTIMATORS``, or an estimator with its options. ``"iv"`` needs samples with
        instruments.

    Returns
    -------
    Fit
        With a model of the errors in ``noise``.

    Raises
    ------
    OptionError
        When there is no such estimator, or something that it needs is not given.
    DataError, RankError
        As ``Estimator.fit``.

    Warns
    -----
    DataWarning
        Naming the parameters whose 95 % interval includes zero.

    Examples
    --------
    Gravity parameters of a five-bar linkage, from 200 random poses:

    >>> import loopid, numpy as np
    >>> robot = loopid.load("five_bar")
    >>> model = loopid.force_model(robot, "gravity", None)
    >>> poses = loopid.random_configurations(robot, 200, seed=0)
    >>> W = model.base.regressor(loopid.regressors.gravity_regressor(robot, poses))
    >>> truth, rng = model.prior, np.random.default_rng(0)
    >>> force = W @ truth + 0.01 * rng.normal(size=W.shape[:2])
    >>> samples = loopid.identification.FitSamples.of(model.parameters, robot.actuated, W, force)
    >>> found = loopid.identification.fit(samples)
    >>> bool((abs(found.values - truth) < 4 * found.standard_errors).all())
    True
    """
    found = working_fit(samples, estimator).result
    names = found.insignificant()
    # Without freedom no interval is finite: the autocorrelation is to blame.
    if names and found.degrees_of_freedom.max() >= LEAST_FREEDOM:
        warn(
            f"{len(names)} of {len(found.values)} parameters are not significantly different from "
            f"zero: {', '.join(names)}",
            DataWarning,
        )
    return found


def quiet_fit(samples: FitSamples, estimator: str | Estimator = "wls") -> Fit:
    """As ``fit``, without warnings."""
    return working_fit(samples, estimator).result


def working_fit(samples: FitSamples, estimator: str | Estimator = "wls") -> WorkingFit:
    """As ``fit``, with the least squares that the fit amounts to, and without warnings."""
    return with_scatter(within_runs(chosen_estimator(estimator).fit_samples(samples)))


@checked
def fit_in_steps(
    first: FitSamples,
    second: FitSamples,
    known: Annotated[Sequence[str], NOT_EMPTY],
    *,
    estimator: str | Estimator = "wls",
) -> Fit:
    """Take known parameters from a first experiment, and the rest from a second.

    All parameters of ``first`` are fitted to it. Those that are known keep their values. Their
    forces are subtracted from ``second``, to which all its other parameters are fitted.

    Parameters
    ----------
    first, second : FitSamples
        Of different experiments, with errors independent of each other.
    known : sequence of str
        Names, in both experiments, of the parameters that the first one determines; joint friction
        for instance.
    estimator : str or Estimator
        As of ``fit``.

    Returns
    -------
    Fit
        All parameters of ``second``; the covariance holds what the uncertainty of the known ones
        does to the others. Quality and noise are those of the second experiment.

    Raises
    ------
    OptionError
        When a known parameter is not in both experiments, or nothing is left for the second.
    DataError, RankError
        As ``fit``.

    Examples
    --------
    Friction from a run of one joint, the rest from another:

    >>> import loopid, numpy as np
    >>> names = loopid.parameters.ParameterSet.from_labels(["arm.mx", "elbow.Fc"])
    >>> rng = np.random.default_rng(0)
    >>> runs = []
    >>> for _ in range(2):
    ...     W = rng.normal(size=(200, 1, 2))
    ...     force = W @ [3.0, 0.5] + 0.1 * rng.normal(size=(200, 1))
    ...     runs.append(loopid.identification.FitSamples.of(names, ["elbow"], W, force))
    >>> found = loopid.identification.fit_in_steps(*runs, known=["elbow.Fc"])
    >>> found.values.round(1)
    array([3. , 0.5])
    """
    for step, samples in (("second", second), ("first", first)):
        for name in known:
            if name not in samples.parameters.labels:
                what = f"parameter of the {step} step"
                raise OptionError.unknown(what, name, samples.parameters.labels)
    held = [second.parameters.labels.index(name) for name in known]
    free = [j for j in range(len(second.parameters)) if j not in held]
    if not free:
        raise OptionError("all parameters of the second step are known: nothing is left to fit")
    start = working_fit(first, estimator).result
    taken = [start.parameters.labels.index(name) for name in known]
    spread = start.covariance[np.ix_(taken, taken)]
    values = np.zeros(len(second.parameters))
    values[held] = start.values[taken]
    fitted = working_fit(second.reduced(free, values), estimator)
    rest = fitted.result
    values[free] = rest.values
    # Errors of the known parameters move the others by -(X₂ᵀX₂)⁻¹ X₂ᵀF, F their columns.
    moved = np.zeros((len(values), len(held)))
    moved[held] = np.eye(len(held))
    moved[free] = -fitted.response(second.select(held).regressor)
    covariance = moved @ spread @ moved.T
    covariance[np.ix_(free, free)] += rest.covariance
    freedom = np.full(len(values), start.degrees_of_freedom[taken].min())
    freedom[held] = start.degrees_of_freedom[taken]
    freedom[free] = np.minimum(freedom[free], rest.degrees_of_freedom)
    return replace(
        rest,
        parameters=second.parameters,
        values=values,
        covariance=covariance,
        degrees_of_freedom=freedom,
        quality=fit_quality(second.problem, values),
    )
