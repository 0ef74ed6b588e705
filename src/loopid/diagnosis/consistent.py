"""Physically consistent parameters: fitted to data, or with exactly given base parameters."""

from __future__ import annotations

import numpy as np

from loopid.arguments import (
    FloatArray,
    checked,
    finite,
)
from loopid.base_parameters.base import BaseParameters
from loopid.diagnosis.consistent_prior import (
    Prior,
    repaired_prior,
    sound_prior,
)
from loopid.diagnosis.consistent_program import (
    Whitening,
    attainable,
    minimise,
)
from loopid.errors import (
    DataError,
    OptionError,
)
from loopid.identification.consistent import (
    ConsistentFit,
    FitCost,
)
from loopid.identification.force_model import ForceModel
from loopid.identification.problem import FitProblem
from loopid.identification.result import FitResult
from loopid.identification.saved import SavedFit
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
# Mass that a body may have, over the robot file's; as which a body without one counts, of the mean.
MOST_MASS, LIGHT = 3.0, 0.01


@checked
def consistent_fit(
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


@checked
def standard_parameters_of(
    saved: SavedFit, model: ForceModel, *, repair: bool = False, any_mass: bool = False
) -> FloatArray:
    """Physically consistent standard parameters (p,) with the base parameters of a saved fit.

    Those of a consistent fit itself; otherwise, of all that there are, those closest to the robot
    file's (``consistent_parameters``).

    Parameters
    ----------
    saved : SavedFit
    model : ForceModel
        From ``SavedFit.find_force_model``.
    repair : bool
        Whether inconsistent bodies of the robot file are repaired first.
    any_mass : bool
        Whether bodies of a fit that is not a consistent one may weigh more than ``MOST_MASS``
        times what the robot file says.

    Raises
    ------
    DataError
        Naming bodies, when there are none, or when one would be that heavy.
    """
    if saved.consistency is not None:
        return saved.standard_values
    prior, columns = model.standard_prior, saved.standard
    if repair:
        prior = repaired_prior(columns, prior)
    # The distance that keeps masses near the prior's where nothing is known of them.
    given = model.base, saved.values, prior
    standard = consistent_parameters(*given, regularisation="euclidean")
    masses = [j for j, parameter in enumerate(columns) if parameter.kind == "m"]
    # A body without a mass of its own in the file counts as a light one.
    known = np.maximum(prior[masses], LIGHT * np.abs(prior[masses]).mean())
    ratios = standard[masses] / np.where(known > 0, known, np.inf)
    worst = int(ratios.argmax())
    if ratios[worst] > MOST_MASS and not any_mass:
        j = masses[worst]
        bayes = saved.estimate is not None and saved.estimate.estimator == "bayes"
        other = "" if bayes else "it as a prior (estimator='bayes'), or "
        raise DataError(
            f"{columns[j].label} would be {standard[j]:.3g} kg, {ratios[worst]:.3g} times what "
            f"the robot file says (most {MOST_MASS:g} times): use {other}a consistent fit "
            "(consistent='entropic', which writes standard_parameters.yaml); if the robot is that "
            "heavy, any_mass=True",
            parameter=columns[j].label,
            mass=float(standard[j]),
            ratio=float(ratios[worst]),
        )
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
