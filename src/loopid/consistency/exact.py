"""Standard parameters that have given base parameters exactly, as close to the prior as can be.

Base parameters as data far more precise than the prior bring the bodies close; from there Newton's
method meets them exactly. Where there are no such bodies, the stiff data are missed: the bodies
that then lie on the boundary are those in conflict.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, finite
from loopid.base_parameters import BaseParameters
from loopid.consistency import log_cholesky
from loopid.consistency.layout import Layout
from loopid.consistency.prior import sound_prior
from loopid.consistency.problem import convex_problem
from loopid.consistency.repair import repaired_prior
from loopid.consistency.settings import MARGIN, checked_margin
from loopid.consistency.whitening import Whitening, whiten
from loopid.errors import DataError, FeasibilityError
from loopid.regions import Region
from loopid.threads import one_blas_thread

STIFFNESS = 1e4  # precision of the base parameters, relative to their size
# If there are bodies with divergence D, the stiff data are missed by at most the root of 2 D: more
# than this would take bodies a thousand times as large as the prior.
FARTHEST = 300.0
CLOSE = 1e-7  # relative: base parameters that are missed by less are not named
ROUND_OFF = 1e-12  # relative: agreement of the base parameters in the end
MOST_NAMED = 5


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Unknowns (q,) that have given base parameters, or come closest.

    Attributes
    ----------
    whitening : Whitening
    unknowns : FloatArray
    missing : FloatArray
        (r,), base parameters that were asked for less those of the unknowns.
    exact : bool
    """

    whitening: Whitening
    unknowns: FloatArray
    missing: FloatArray
    exact: bool


@checked
def consistent_parameters(
    base: BaseParameters,
    values: FloatArray,
    prior: FloatArray,
    *,
    regularisation: str = "entropic",
    regions: Mapping[str, Region] | None = None,
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
    prior : FloatArray
        Standard parameters (p,), zero for terms of joints that are not known.
    regularisation : str
        What closest means: ``"entropic"``, ``"euclidean"`` or ``"riemannian"``.
    regions : mapping, optional
        From names of bodies: where their centres of mass may lie.
    margin : float
        Least eigenvalue of a pseudo-inertia relative to the prior's.
    repair : bool
        Whether bodies of the prior that cannot exist are mended (``repaired_prior``).

    Returns
    -------
    FloatArray
        (p,).

    Raises
    ------
    FeasibilityError
        Naming the bodies and base parameters in conflict when there are none; or the bodies of the
        prior that are none.
    """
    target, start = _checked_values(base, values), prior
    if repair:
        start = repaired_prior(base.parameters, prior, regions)
    sound = sound_prior(base.parameters, start, regions or {})
    whitening = whiten(base, sound, regions or {}, checked_margin(margin))
    with one_blas_thread():
        found = reproduce(base, target, whitening, regularisation)
    if not found.exact:
        raise FeasibilityError(_conflict(base, target, found))
    standard, positive = whitening.standard_parameters(found.unknowns), sound.layout.positive
    standard[positive] = np.maximum(standard[positive], 0.0)  # by no more than round-off
    return standard


def reproduce(
    base: BaseParameters, values: FloatArray, whitening: Whitening, regularisation: str = "entropic"
) -> Reproduction:
    """Look for unknowns with the given base parameters (r,)."""
    E = base.matrix @ whitening.map
    wanted = values - base.values(whitening.prior.values)
    sizes = np.maximum(np.linalg.norm(E, axis=1) + np.abs(wanted), np.finfo(float).tiny)
    rows, aim = E / sizes[:, None], wanted / sizes
    given = _given_terms(base, values, whitening.prior.layout)
    if all(value >= 0 for value in given.values()):
        # They may be zero: on the boundary, where no solver goes.
        whitening = whitening.without_rows(given)
    stiff = STIFFNESS * rows, STIFFNESS * aim
    close = log_cholesky.solve(convex_problem(whitening, *stiff, regularisation, 1.0)).unknowns
    if STIFFNESS * np.linalg.norm(aim - rows @ close) <= FARTHEST:
        problem = convex_problem(whitening, rows, aim, regularisation, 1.0, exact=True)
        found = log_cholesky.solve(problem, close)
        x = found.unknowns + np.linalg.pinv(rows) @ (aim - rows @ found.unknowns)
        if found.settled and np.abs(aim - rows @ x).max() <= ROUND_OFF and whitening.allows(x):
            return Reproduction(whitening, x, wanted - E @ x, True)
    return Reproduction(whitening, close, wanted - E @ close, False)


def _given_terms(base: BaseParameters, values: FloatArray, layout: Layout) -> dict[str, float]:
    """Joint terms that cannot be negative and are base parameters by themselves, with values."""
    alone = (base.matrix != 0).sum(axis=1) == 1
    return {
        base.names[i]: float(values[i])
        for i in np.flatnonzero(alone)
        if base.base[i] in layout.positive and (base.matrix[:, base.base[i]] != 0).sum() == 1
    }


def _checked_values(base: BaseParameters, values: FloatArray) -> FloatArray:
    target = finite(values, "base parameters")
    if target.shape != (len(base),):
        raise DataError(f"base parameters must have shape ({len(base)},), not {target.shape}")
    return target


def _conflict(base: BaseParameters, values: FloatArray, found: Reproduction) -> str:
    """Which bodies would have to be impossible, and which base parameters are out of reach."""
    names = found.whitening.boundary(found.unknowns)
    size = np.abs(values) + np.abs(base.values(found.whitening.prior.values))
    share = np.abs(found.missing) / np.maximum(size, np.finfo(float).tiny)
    worst = np.argsort(-share)[:MOST_NAMED]
    listed = ", ".join(
        f"{base.names[j]} = {values[j]:.4g} (possible: {values[j] - found.missing[j]:.4g})"
        for j in worst
        if share[j] > CLOSE
    )
    at = f" of {', '.join(names)}" if names else ""
    reach = f"; out of reach: {listed}" if listed else ", but some come within round-off"
    return f"no possible parameters{at} have these base parameters{reach}"
