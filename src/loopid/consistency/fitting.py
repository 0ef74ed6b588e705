"""One call from a fit to bodies that can exist."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from time import perf_counter

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.base_parameters import BaseParameters
from loopid.consistency import conic, log_cholesky
from loopid.consistency.exact import reproduce
from loopid.consistency.prior import Prior, sound_prior
from loopid.consistency.problem import ConvexProblem, convex_problem
from loopid.consistency.repair import repaired_prior
from loopid.consistency.result import ConsistentFit, FitCost
from loopid.consistency.settings import MARGIN, STRENGTH, checked_margin, checked_strength
from loopid.consistency.whitening import Whitening, whiten
from loopid.errors import DataError, FeasibilityError, OptionError
from loopid.identification import FitProblem, FitResult
from loopid.regions import Region
from loopid.threads import one_blas_thread

SOLVERS = ("auto", "clarabel", "log-cholesky")
# Residuals below this part of the forces are round-off: data are never taken for more precise.
EXACT_DATA = 1e-6


@checked
def consistent_fit(
    problem: FitProblem,
    fit: FitResult,
    base: BaseParameters,
    prior: FloatArray,
    *,
    regularisation: str = "entropic",
    strength: float = STRENGTH,
    regions: Mapping[str, Region] | None = None,
    solver: str = "auto",
    margin: float = MARGIN,
    repair: bool = False,
) -> ConsistentFit:
    """Fit all standard parameters, every body one that can exist.

    Minimises half the weighted squared residuals in units of their variance plus the strength
    times the distance from the prior, with all pseudo-inertias positive definite.

    Parameters
    ----------
    problem : FitProblem
        The data, of the base parameters.
    fit : FitResult
        The unconstrained fit, with the weights of the actuators.
    base : BaseParameters
    prior : FloatArray
        Standard parameters (p,) as of the robot file, zero for terms of joints that are not known.
    regularisation : str
        Distance from the prior: ``"entropic"``, ``"euclidean"`` or ``"riemannian"``.
    strength : float
        How many observations the prior counts for.
    regions : mapping, optional
        From names of bodies: where their centres of mass may lie.
    solver : str
        ``"clarabel"`` (extra sdp), ``"log-cholesky"``, or ``"auto"`` for the first that is there.
    margin : float
        Least eigenvalue of a pseudo-inertia relative to the prior's.
    repair : bool
        Whether bodies of the prior that cannot exist are mended (``repaired_prior``).

    Raises
    ------
    FeasibilityError
        Naming the bodies of the prior that cannot exist.
    DataError, OptionError, MissingExtraError
    """
    begin = perf_counter()
    _check(problem, fit, base, solver)
    start = repaired_prior(base.parameters, prior, regions) if repair else prior
    sound = sound_prior(base.parameters, start, regions or {})
    whitening = whiten(base, sound, regions or {}, checked_margin(margin))
    with one_blas_thread():
        convex = _problem(problem, fit, base, whitening, regularisation, checked_strength(strength))
        unknowns, used = _solved(convex, solver)
        feasible = reproduce(base, fit.values, whitening).exact
    standard = whitening.standard_parameters(unknowns)
    return ConsistentFit(
        parameters=base.parameters,
        standard_parameters=standard,
        base_parameters=problem.parameters,
        values=base.values(standard),
        feasible=feasible,
        fit_cost=_cost(problem, fit, base.values(standard)),
        bodies=sound.layout.bodies,
        margins=whitening.margins(unknowns),
        boundary=whitening.boundary(unknowns),
        repaired=_repaired(sound, prior),
        regularisation=regularisation,
        strength=float(strength),
        margin=float(margin),
        solver=used,
        seconds=perf_counter() - begin,
    )


def _check(problem: FitProblem, fit: FitResult, base: BaseParameters, solver: str) -> None:
    leading = base.parameters.select(base.base)
    if problem.parameters != leading or fit.parameters != leading:
        raise DataError("problem and fit must be of the base parameters, in their order")
    if fit.actuators != problem.actuators:
        raise DataError("problem and fit must have the same actuators")
    if solver not in SOLVERS:
        raise OptionError.unknown("solver", solver, SOLVERS)


def _problem(
    problem: FitProblem,
    fit: FitResult,
    base: BaseParameters,
    whitening: Whitening,
    regularisation: str,
    strength: float,
) -> ConvexProblem:
    """Distances from the fit's values as the data weigh them, in units of their variance."""
    R = problem.weighted(fit.weights)[:-1, :-1] / np.sqrt(_variance(problem, fit))
    data = R @ base.matrix @ whitening.map
    target = R @ (fit.values - base.values(whitening.prior.values))
    return convex_problem(whitening, data, target, regularisation, strength)


def _variance(problem: FitProblem, fit: FitResult) -> float:
    """Of the weighted residuals; at least round-off of the weighted forces."""
    squares = fit.weights**2 @ problem.residual_squares(fit.values)
    freedom = max(problem.rows - len(problem.parameters), 1)
    least = EXACT_DATA**2 * (fit.weights**2 @ problem.force_squares()) / problem.rows
    return float(max(squares / freedom, least)) or 1.0


def _solved(convex: ConvexProblem, solver: str) -> tuple[FloatArray, str]:
    """The solution, and which solver found it: log-Cholesky where Clarabel falls short."""
    if solver == "clarabel" or (solver == "auto" and find_spec("clarabel")):
        try:
            return conic.solve(convex), "clarabel"
        except FeasibilityError:
            if solver == "clarabel":
                raise
    solution = log_cholesky.solve(convex)
    if not solution.settled:
        raise FeasibilityError("the consistent fit does not settle: raise its strength")
    return solution.unknowns, "log-cholesky"


def _cost(problem: FitProblem, fit: FitResult, values: FloatArray) -> FitCost:
    before, after = (problem.residual_squares(v) for v in (fit.values, values))
    counts = np.where(problem.samples > 0, problem.samples, np.nan)
    totals = [float(fit.weights**2 @ squares) for squares in (before, after)]
    with np.errstate(divide="ignore", invalid="ignore"):
        total = np.sqrt(np.divide(totals[1], totals[0])) if totals[1] > 0 else 1.0
    return FitCost(
        problem.actuators, np.sqrt(before / counts), np.sqrt(after / counts), float(total)
    )


def _repaired(sound: Prior, given: FloatArray) -> tuple[str, ...]:
    """Names of the bodies and joint terms whose prior is not as it was given."""
    changed = np.flatnonzero(sound.values != np.asarray(given))
    owners = dict.fromkeys(sound.layout.owner(int(j)) for j in changed)
    return tuple(owners)
