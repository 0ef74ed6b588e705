"""Physically consistent parameters: fitted to data, or with exactly given base parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, Number, checked, finite
from loopid.base_parameters.base import BaseParameters
from loopid.errors import DataError, OptionError
from loopid.identification.consistent_program import (
    Prior,
    Whitening,
    attainable,
    minimise,
    repaired_prior,
    sound_prior,
)
from loopid.identification.problem import FitProblem
from loopid.identification.result import FitResult, OfArrays
from loopid.parameters import ParameterSet
from loopid.records import record
from loopid.workers import one_blas_thread

# Least eigenvalue of a pseudo-inertia relative to the prior's.
MARGIN = 1e-3
# The prior counts as one observation of every parameter that is off by as much as it is large.
STRENGTH = 1.0
# Weaker priors drown in the round-off of the data.
LEAST_STRENGTH = 1e-4
# Residuals below this part of the forces are round-off: data are never taken for more precise.
EXACT_DATA = 1e-6
STIFFNESS = 1e4  # precision of base parameters that are approached only, relative to their size
CLOSE = 1e-7  # relative: base parameters that are missed by less are not named
MOST_NAMED = 5


@record
class FitCost(OfArrays):
    """Residuals with and without the constraints.

    Attributes
    ----------
    actuators : tuple of str
    unconstrained, constrained : FloatArray
        Root mean squares (dof,) in N or N m; NaN without samples.
    total : float
        Weighted root mean square of all residuals, constrained over unconstrained.
    """

    actuators: tuple[str, ...]
    unconstrained: FloatArray
    constrained: FloatArray
    total: Number


@record
class ConsistentFit:
    """Physically consistent standard parameters, fitted to data.

    Attributes
    ----------
    parameters : ParameterSet
        The p standard parameters, joint terms included.
    standard_parameters : FloatArray
        (p,), pseudo-inertias positive definite.
    base_parameters : ParameterSet
        Leading parameters of the r base parameters.
    values : FloatArray
        Base parameters (r,) of the standard ones.
    feasible : bool
        Whether consistent parameters have exactly the base parameters of the unconstrained fit.
    fit_cost : FitCost
    bodies : tuple of str
    margins : FloatArray
        (bodies,), least eigenvalue of each pseudo-inertia relative to the prior's; NaN for massless
        bodies.
    boundary : tuple of str
        Bodies and joint terms that the data pull onto the boundary of what is consistent.
    repaired : tuple of str
        Bodies whose prior was repaired.
    regularisation : str
    strength, margin : float
    """

    parameters: ParameterSet
    standard_parameters: FloatArray
    base_parameters: ParameterSet
    values: FloatArray
    feasible: bool
    fit_cost: FitCost
    bodies: tuple[str, ...]
    margins: FloatArray
    boundary: tuple[str, ...]
    repaired: tuple[str, ...]
    regularisation: str
    strength: float
    margin: float

    @property
    def rows(self) -> Iterator[dict[str, Any]]:
        """A row of a table for each body: its name, mass in kg, centre of mass in m and margin."""
        places = {label: k for k, label in enumerate(self.parameters.labels)}
        for body, margin in zip(self.bodies, self.margins, strict=True):
            own = [places[f"{body}.{kind}"] for kind in ("m", "mx", "my", "mz")]
            mass, *first = map(float, self.standard_parameters[own])
            centre = (moment / mass if mass else float("nan") for moment in first)
            row = dict(zip("xyz", centre, strict=True))
            yield {"body": body, "mass": mass, **row, "margin": float(margin)}

    def _summary(self) -> str:
        verdict = "feasible" if self.feasible else "not feasible"
        return (
            f"unconstrained optimum {verdict}; consistency costs "
            f"{100 * (self.fit_cost.total - 1):.2g} % of the residual rms "
            f"({self.regularisation}, strength {self.strength:g})"
        )

    def __repr__(self) -> str:
        return f"<ConsistentFit of {len(self.bodies)} bodies: {self._summary()}>"

    def __str__(self) -> str:
        lines = [self._summary()]
        for row in self.rows:
            centre = ", ".join(f"{row[axis]:.4g}" for axis in "xyz")
            lines.append(
                f"{row['body']}: {row['mass']:.4g} kg at ({centre}) m, margin {row['margin']:.2g}"
            )
        if self.boundary:
            lines.append(f"on the boundary: {', '.join(self.boundary)}")
        return "\n".join(lines)


@checked
def consistent_fit(  # noqa: PLR0913 (a fit, and how it is weighed)
    problem: FitProblem,
    fit: FitResult,
    base: BaseParameters,
    prior: FloatArray,
    *,
    regularisation: str = "entropic",
    strength: float = STRENGTH,
    margin: float = MARGIN,
    repair: bool = False,
) -> ConsistentFit:
    """Fit all standard parameters, every body physically consistent [Wensing2018; Lee2020].

    Minimises half the weighted squared residuals in units of their variance plus the strength
    times the distance from the prior, with all pseudo-inertias positive definite: a semidefinite
    program, solved by Clarabel (``pip install 'loopid[sdp]'``).

    Parameters
    ----------
    problem : FitProblem
        The data, of the base parameters.
    fit : FitResult
        The unconstrained fit, with the weights of the actuators.
    base : BaseParameters
    prior : FloatArray
        Standard parameters (p,) as of the robot file, zero for joint terms that are not known; kg,
        kg m and kg m² (``ForceModel.standard_prior``).
    regularisation : str
        Distance from the prior: ``"entropic"``, ``"euclidean"`` or ``"riemannian"``.
    strength : float
        How many observations the prior counts for.
    margin : float
        Least eigenvalue of a pseudo-inertia relative to the prior's.
    repair : bool
        Whether bodies of the prior that are not consistent are repaired (``repaired_prior``).

    Raises
    ------
    DataError
        Naming the bodies of the prior that are not consistent, or when Clarabel does not converge.
    MissingExtraError
        Without Clarabel.
    DataError, OptionError
        When arguments do not belong together, or an option is out of range.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> model = loopid.find_force_model(robot, joint_terms=None)
    >>> q, at_rest = loopid.random_configurations(robot, 50), np.zeros((50, 2))
    >>> W = model.base.regressor(model.standard_regressor(q, at_rest, at_rest))
    >>> force = W @ model.prior + np.random.default_rng(0).normal(size=(50, 2))
    >>> samples = loopid.FitSamples.of(model.parameters, robot.independent, W, force)
    >>> fit = loopid.fit(samples, "ols")
    >>> result = loopid.consistent_fit(samples.problem, fit, model.base, model.standard_prior)
    >>> bool((result.margins > 0.001).all())
    True
    """
    leading = base.parameters.select(base.base)
    if problem.parameters != leading or fit.parameters != leading:
        raise DataError("problem and fit must be of the base parameters, in their order")
    if fit.actuators != problem.actuators:
        raise DataError("problem and fit must have the same actuators")
    if not LEAST_STRENGTH <= strength < np.inf:
        raise OptionError(f"the strength must be from {LEAST_STRENGTH:g} on, not {strength}")
    sound, whitening = _whitened(base, prior, margin, repair)
    before, weights = problem.residual_squares(fit.values), fit.weights**2
    # Of the weighted residuals; at least round-off of the weighted forces.
    freedom = max(problem.rows - len(problem.parameters), 1)
    round_off = EXACT_DATA**2 * (weights @ problem.force_squares()) / problem.rows
    variance = float(max(weights @ before / freedom, round_off)) or 1.0
    with one_blas_thread():
        # The fit is the distance from the unconstrained values as the data weigh it.
        R = problem.weighted(fit.weights)[:-1, :-1] / np.sqrt(variance)
        data = R @ base.matrix @ whitening.map
        target = R @ (fit.values - base.values(sound.values))
        unknowns = minimise(whitening, data, target, regularisation, strength)
        feasible = attainable(*_equations(base, fit.values, whitening))
    standard = whitening.standard_parameters(unknowns)
    after = problem.residual_squares(base.values(standard))
    counts = np.where(problem.samples > 0, problem.samples, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        unconstrained, constrained = np.sqrt(before / counts), np.sqrt(after / counts)
        total = np.sqrt(weights @ after / (weights @ before)) if weights @ after > 0 else 1.0
    changed = np.flatnonzero(sound.values != np.asarray(prior))
    return ConsistentFit(
        parameters=base.parameters,
        standard_parameters=standard,
        base_parameters=problem.parameters,
        values=base.values(standard),
        feasible=feasible,
        fit_cost=FitCost(problem.actuators, unconstrained, constrained, float(total)),
        bodies=sound.layout.bodies,
        margins=whitening.margins(unknowns),
        boundary=whitening.boundary(unknowns),
        repaired=tuple(dict.fromkeys(sound.layout.owner(int(j)) for j in changed)),
        regularisation=regularisation,
        strength=float(strength),
        margin=float(margin),
    )


@checked
def consistent_parameters(
    base: BaseParameters,
    values: FloatArray,
    prior: FloatArray,
    *,
    regularisation: str = "entropic",
    margin: float = MARGIN,
    repair: bool = False,
) -> FloatArray:
    """Physically consistent standard parameters with exactly the given base parameters.

    Of all there are, those closest to the prior.

    Parameters
    ----------
    base : BaseParameters
    values : FloatArray
        Base parameters (r,), as ``base.values``.
    prior, regularisation, margin, repair
        As in ``consistent_fit``.

    Returns
    -------
    FloatArray
        (p,), in kg, kg m, kg m² and the units of the joint terms.

    Raises
    ------
    DataError
        Naming the bodies and base parameters in conflict when there are none; or the bodies of the
        prior that are not consistent.
    MissingExtraError
        Without Clarabel.
    DataError, OptionError
        When arguments do not belong together, or an option is out of range.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("five_bar")
    >>> model = loopid.find_force_model(robot, "full", None)
    >>> heavier = 1.2 * model.prior
    >>> standard = loopid.consistent_parameters(model.base, heavier, model.standard_prior)
    >>> bool(abs(model.base.values(standard) - heavier).max() < 1e-9)
    True
    """
    target = finite(values, "base parameters")
    if target.shape != (len(base),):
        raise DataError(f"base parameters must have shape ({len(base)},), not {target.shape}")
    sound, whitening = _whitened(base, prior, margin, repair)
    with one_blas_thread():
        whitening, rows, aim = _equations(base, target, whitening)
        if not attainable(whitening, rows, aim):
            near = minimise(
                whitening, STIFFNESS * rows, STIFFNESS * aim, "riemannian", refuse=False
            )
            raise DataError(_conflict(base, target, whitening, near))
        unknowns = minimise(whitening, rows, aim, regularisation, exact=True)
    standard, positive = whitening.standard_parameters(unknowns), sound.layout.positive
    standard[positive] = np.maximum(standard[positive], 0.0)  # by no more than round-off
    return standard


def _whitened(
    base: BaseParameters, prior: FloatArray, margin: float, repair: bool
) -> tuple[Prior, Whitening]:
    if not 0 <= margin < 1:
        raise OptionError(f"the margin must be from 0 on and below 1, not {margin}")
    start = repaired_prior(base.parameters, prior) if repair else prior
    sound = sound_prior(base.parameters, start)
    return sound, Whitening.about(base, sound, margin)


def _equations(
    base: BaseParameters, values: FloatArray, whitening: Whitening
) -> tuple[Whitening, FloatArray, FloatArray]:
    """Rows (r, q) and aims (r,) of size one: given base parameters as equations of the unknowns.

    With the constraints less those of joint terms that are given: where they are zero, they lie on
    the boundary, which has no inside.
    """
    rows = base.matrix @ whitening.map
    aim = values - base.values(whitening.prior.values)
    sizes = np.maximum(np.linalg.norm(rows, axis=1) + np.abs(aim), np.finfo(float).tiny)
    effects, positive = base.matrix != 0, whitening.prior.layout.positive
    given = [
        name
        for i, name in enumerate(base.names)
        if base.base[i] in positive
        and effects[i].sum() == effects[:, base.base[i]].sum() == 1
        and values[i] >= 0
    ]
    return whitening.without_limits(given), rows / sizes[:, None], aim / sizes


def _conflict(
    base: BaseParameters, values: FloatArray, whitening: Whitening, nearest: FloatArray
) -> str:
    """Which bodies would have to be inconsistent, and which base parameters are out of reach."""
    names = whitening.boundary(nearest)
    reached = base.values(whitening.standard_parameters(nearest))
    size = np.abs(values) + np.abs(base.values(whitening.prior.values))
    share = np.abs(values - reached) / np.maximum(size, np.finfo(float).tiny)
    listed = ", ".join(
        f"{base.names[j]} = {values[j]:.4g} (possible: {reached[j]:.4g})"
        for j in np.argsort(-share)[:MOST_NAMED]
        if share[j] > CLOSE
    )
    at = f" of {', '.join(names)}" if names else ""
    reach = f"; out of reach: {listed}" if listed else ", but some come within round-off"
    return (
        f"no physically consistent parameters{at} have these base parameters{reach}; a consistent "
        "fit to the same data comes close (consistent='entropic'): use its standard parameters"
    )
