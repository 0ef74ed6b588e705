"""The semidefinite program of the consistent fit, with every body in units of its prior.

With P0 = L Lᵀ the pseudo-inertia of the prior and a margin ε, the unknowns X of a body are

    P = L (1 + Z) Lᵀ,  Z = (1 - ε) X,  so that  1 + X >= 0  means  P >= ε P0.

Zero is the prior, and one the size of the prior, for bodies of grams and of tonnes alike. The
distances from the prior, summed over the bodies, are [Wensing2018; Lee2018; Lee2020]

- entropic, tr X - log det(1 + X): the Bregman divergence of -log det, from P to the prior;
- Riemannian, ½‖Z‖²: half the squared length of P - P0 in the affine-invariant metric at P0, the
  "constant pull-back" of the geodesic distance;
- Euclidean, ½ of the sum of squared changes of the ten parameters, in units of the body's mass m
  and of its mean radius ρ about the centre of mass: m, m ρ and m ρ².

The first two depend neither on units nor on frames. The program is Clarabel's [Goulart2024], which
has no cone of log det. With a lower triangular K,

    [1 + X, K; Kᵀ, diag K] >= 0  and  t_i <= log K_ii

make Σ t a lower bound of log det(1 + X), attained at its maximum.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked, finite, frozen
from loopid.base_parameters.base import BaseParameters
from loopid.errors import DataError, MissingExtraError, OptionError
from loopid.inertia import (
    body_defect,
    central_moments,
    from_moments,
    parameters_of,
    pseudo_inertia,
    upper_factor,
)
from loopid.parameters import GRAVITY_KINDS, KINDS, ParameterSet

REGULARISATIONS = ("entropic", "euclidean", "riemannian")
# Weight of the tie-breaking pull on what has no prior, relative to what has one.
TIE_BREAK = 1e-6
# Relative to the prior: eigenvalues, and values, up to which a body or term is on the boundary.
TOUCHING, FLUSH = 1e-2, 1e-5
# Singular values of the data below this part of the largest are round-off.
NEGLIGIBLE = 1e-14
TOLERANCE = 1e-10  # of Clarabel: duality gap and residuals
# A solution that is almost within it counts where the duality gap proves the objective this well.
SOLVED, LARGEST_GAP = ("Solved", "AlmostSolved"), 1e-6
# So deep inside the constraints solutions are looked for, relative to the prior: far deeper than
# what Clarabel leaves open, so that no verdict hangs on round-off. Equations count as satisfiable
# where they are at twice this depth.
DEPTH = 1e-6
ROUND_OFF = 1e-12  # of equations whose rows and targets are of size one
# Terms of joints that cannot be negative: drive inertia, Coulomb and viscous friction.
POSITIVE_KINDS = ("Ia", "Fc", "Fv")
# A repaired body is at least so thick: second moments of a thirtieth of its length.
THICKNESS = 1e-3
# Second moments below this part of what the mass has at the origin are round-off: a point.
POINT = 1e-12


class _Defect(NamedTuple):
    """Why a body, or a joint term, of the prior is not physically consistent."""

    name: str
    reason: str
    repairable: bool

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Layout:
    """Where bodies (links, or groups of tied links) and joint terms stand among p parameters.

    ``columns`` (bodies, 4) or (bodies, 10) are the places of each body's parameters in the order
    of ``KINDS``, ``positive`` those of the joint terms that cannot be negative.
    """

    parameters: ParameterSet
    bodies: tuple[str, ...]
    columns: IntArray
    joint_columns: IntArray
    positive: IntArray

    @classmethod
    def of(cls, parameters: ParameterSet) -> Layout:
        """Sort parameters by bodies, each with the four of the gravity model or all with ten."""
        places: dict[str, dict[str, int]] = {}
        for column, parameter in enumerate(parameters):
            if parameter.kind in KINDS:
                places.setdefault(parameter.link, {})[parameter.kind] = column
        gravity = all(set(found) <= set(GRAVITY_KINDS) for found in places.values())
        kinds = GRAVITY_KINDS if gravity else KINDS
        for body, found in places.items():
            missing = [kind for kind in kinds if kind not in found]
            if missing:
                raise DataError(f"body {body} lacks the parameters {', '.join(missing)}")
        columns = [[found[kind] for kind in kinds] for found in places.values()]
        joint = [j for j, parameter in enumerate(parameters) if parameter.kind not in KINDS]
        return cls(
            parameters,
            tuple(places),
            frozen(np.reshape(columns, (len(places), len(kinds))), np.int64),
            frozen(joint, np.int64),
            frozen([j for j in joint if parameters[j].kind in POSITIVE_KINDS], np.int64),
        )

    @property
    def full(self) -> bool:
        """Whether the bodies have inertias."""
        return bool(self.columns.shape[1] == len(KINDS))

    def owner(self, column: int) -> str:
        """The body of a parameter, or the label of a joint term."""
        parameter = self.parameters[column]
        return parameter.link if parameter.kind in KINDS else parameter.label


@dataclass(frozen=True, eq=False)
class Prior:
    """Values (p,) with a positive definite pseudo-inertia for every body that has a mass.

    ``bodies`` are those that are not massless, with the places of their parameters in ``columns``
    (bodies, 4) or (bodies, 10), and ``factors`` (bodies, 4, 4), upper triangular L of P0 = L Lᵀ.
    """

    layout: Layout
    values: FloatArray
    bodies: tuple[str, ...]
    columns: IntArray
    factors: FloatArray


def sound_prior(parameters: ParameterSet, prior: FloatArray) -> Prior:
    """The prior, refused with the names of the bodies that are not physically consistent.

    Bodies of nothing but zeros are massless, which is no defect.
    """
    layout, values = _checked(parameters, prior)
    defects = _defects(layout, values)
    if defects:
        raise DataError(
            f"the prior of {', '.join(defect.name for defect in defects)} is not physically "
            f"consistent: {'; '.join(map(str, defects))}; correct these values, or repair them, "
            "repair=True"
        )
    massive = np.flatnonzero(values[layout.columns].any(axis=1))
    bodies, columns = tuple(layout.bodies[k] for k in massive), layout.columns[massive]
    own = values[columns]
    if layout.full:
        P = pseudo_inertia(own)
    else:
        # Bodies whose second moments are not known are cubes that reach as far as the centres of
        # mass are from the links' origins, in the root mean square.
        centres = own[:, 1:] / own[:, :1]
        reach = np.sqrt((centres**2).sum() / max(len(own), 1))
        if not reach > 0:
            raise DataError(
                "all centres of mass of the prior are in the origins of their links, so that "
                "nothing tells how large the bodies are: use the full model"
            )
        P = np.empty((len(own), 4, 4))
        for k, (mass, *_) in enumerate(own):
            P[k] = from_moments(mass, centres[k], mass * reach**2 / 3 * np.eye(3))
    return Prior(layout, frozen(values), bodies, columns, upper_factor(P))


@checked
def repaired_prior(parameters: ParameterSet, prior: FloatArray) -> FloatArray:
    """The prior with bodies that are too thin made thicker.

    Second moments about the centre of mass become at least ``THICKNESS`` of the body's largest; a
    body without any extent becomes a ball as large as the other bodies are on average. Masses are
    kept. Friction and drive inertia that is negative becomes zero. What is consistent stays as it
    is, to the bit.

    Parameters
    ----------
    parameters : ParameterSet
        The p standard parameters, joint terms among them or not.
    prior : FloatArray
        Their values (p,).

    Returns
    -------
    FloatArray
        (p,).

    Raises
    ------
    DataError
        Naming bodies whose defect is none of these, such as a negative mass.
    DataError
        When the values have another shape or are not finite, or a body lacks parameters.
    """
    layout, values = _checked(parameters, prior)
    defects = _defects(layout, values)
    lost = [defect for defect in defects if not defect.repairable]
    if lost:
        raise DataError(f"the prior cannot be repaired: {'; '.join(map(str, lost))}")
    # Mean second moment over mass (m²) of the bodies that have an extent.
    own = values[layout.columns]
    solid = pseudo_inertia(own[own[:, 0] > 0]) if layout.full else np.empty((0, 4, 4))
    extents = [np.trace(central_moments(P)) / (3 * P[3, 3]) for P in solid]
    ball = float(np.mean([extent for extent in extents if extent > 0] or [0.0]))
    repaired = values.copy()
    repaired[layout.positive] = np.maximum(values[layout.positive], 0.0)
    for name in (defect.name for defect in defects if defect.name in layout.bodies):
        columns = layout.columns[layout.bodies.index(name)]
        repaired[columns] = _thicker(name, values[columns], ball)
    return repaired


def _checked(parameters: ParameterSet, values: FloatArray) -> tuple[Layout, FloatArray]:
    """The layout of parameters and the values (p,), where they fit together."""
    prior = finite(values, "prior")
    if prior.shape != (len(parameters),):
        raise DataError(f"the prior must have shape ({len(parameters)},), not {prior.shape}")
    return Layout.of(parameters), prior


def _defects(layout: Layout, values: FloatArray) -> list[_Defect]:
    found = []
    for body, columns in zip(layout.bodies, layout.columns, strict=True):
        own = values[columns]
        if not own.any():
            continue
        # Of the gravity model only the mass is judged: its bodies may be points.
        P = pseudo_inertia(np.pad(own, (0, len(KINDS) - len(own))))
        reason = body_defect(P) if layout.full or own[0] <= 0 else ""
        if reason:
            found.append(_Defect(body, reason, bool(own[0] > 0)))
    for j in layout.positive:
        if values[j] < 0:
            what = f"it cannot be negative ({values[j]:.3g})"
            found.append(_Defect(layout.parameters[int(j)].label, what, True))
    return found


def _thicker(name: str, own: FloatArray, ball: float) -> FloatArray:
    """A body (10,) whose second moments are large enough."""
    mass, centre = float(own[0]), own[1:4] / own[0]
    moments, axes = np.linalg.eigh(central_moments(pseudo_inertia(own)))
    has_extent = moments[2] > POINT * mass * (centre @ centre)
    moments = np.maximum(moments, THICKNESS * moments[2] if has_extent else mass * ball)
    if moments[0] <= 0:
        raise DataError(f"no body tells how large {name} is: the prior cannot be repaired")
    return parameters_of(from_moments(mass, centre, axes * moments @ axes.T))


def vector(matrix: FloatArray) -> FloatArray:
    """Symmetric matrices (..., n, n) as vectors, as Clarabel wants them.

    The upper triangle column by column, off-diagonal entries times √2, so that tr(A B) = aᵀ b.
    """
    columns, rows = np.tril_indices(matrix.shape[-1])
    scales = np.where(rows == columns, 1.0, np.sqrt(2.0))
    return np.asarray(matrix[..., rows, columns] * scales, dtype=np.float64)


def matrix(vectors: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 4, 4) of vectors (..., 10)."""
    found = np.empty((*vectors.shape[:-1], 4, 4))
    found[..., ROWS, COLUMNS] = found[..., COLUMNS, ROWS] = vectors / SCALES
    return found


COLUMNS, ROWS = np.tril_indices(4)
WIDTH = len(ROWS)
SCALES = np.where(ROWS == COLUMNS, 1.0, np.sqrt(2.0))
IDENTITY = vector(np.eye(4))
UNITS = matrix(np.eye(WIDTH))
# Entries that only second moments depend on, which the gravity model does not have.
HIDDEN = (ROWS < 3) & (COLUMNS < 3)
# The cone [1 + X, K; Kᵀ, diag K] by X (36, 10), and by the lower triangle of K (36, 10).
_NOTHING, _K = np.zeros((2, WIDTH, 4, 4))
_K[range(WIDTH), COLUMNS, ROWS] = 1.0
LIFTED = vector(np.block([[UNITS, _NOTHING], [_NOTHING, _NOTHING]])).T
LIFTED_FACTOR = vector(np.block([[_NOTHING, _K], [_K.swapaxes(1, 2), _K * np.eye(4)]])).T


@dataclass(frozen=True, eq=False)
class Whitening:
    """Standard parameters Φ = Φ0 + T x of whitened unknowns x, and what x must obey.

    Unknowns are ten a body, then one a joint term.
    """

    prior: Prior
    margin: float
    map: FloatArray  # T (p, q)
    positive: IntArray  # unknowns (k,) of the joint terms that cannot be negative
    # (k,), of these terms where the unknowns are zero: 0, or 1 for those with a prior
    levels: FloatArray
    positive_names: tuple[str, ...]  # labels of these terms
    pull: FloatArray  # weights of the joint terms in any regularisation

    @classmethod
    def about(cls, base: BaseParameters, prior: Prior, margin: float) -> Whitening:
        """Whitened unknowns about a prior."""
        layout, inside = prior.layout, WIDTH * len(prior.bodies)
        terms = prior.values[layout.joint_columns]
        # A joint term without a prior has the size at which it weighs as much as the whole prior.
        F = np.zeros((base.structure.rank, len(base.parameters)))
        F[:, base.structure.columns] = base.structure.row_factor
        weights = np.linalg.norm(F[:, layout.joint_columns], axis=0)
        whole = float(np.linalg.norm(F @ prior.values)) or 1.0
        sizes = np.divide(whole, weights, out=np.ones(len(weights)), where=weights > 0)
        T = np.zeros((len(layout.parameters), inside + len(terms)))
        T[layout.joint_columns, inside + np.arange(len(terms))] = np.where(
            terms != 0, np.abs(terms), sizes
        )
        for k, (L, columns) in enumerate(zip(prior.factors, prior.columns, strict=True)):
            changes = (1 - margin) * parameters_of(L @ UNITS @ L.T)
            T[columns, _body(k)] = changes[:, : len(columns)].T
        return cls(
            prior=prior,
            margin=margin,
            map=T,
            positive=inside + np.searchsorted(layout.joint_columns, layout.positive),
            levels=(prior.values[layout.positive] != 0).astype(np.float64),
            positive_names=layout.parameters.select(layout.positive).labels,
            pull=np.where(terms != 0, 1.0, TIE_BREAK),
        )

    @property
    def inside(self) -> int:
        """Number of unknowns that belong to bodies."""
        return WIDTH * len(self.prior.bodies)

    def without_limits(self, names: Collection[str]) -> Whitening:
        """The same without the limits of some of the joint terms."""
        kept = [k for k, name in enumerate(self.positive_names) if name not in names]
        rest = tuple(self.positive_names[k] for k in kept)
        limits = self.positive[kept], self.levels[kept]
        return replace(self, positive=limits[0], levels=limits[1], positive_names=rest)

    def standard_parameters(self, unknowns: FloatArray) -> FloatArray:
        """Φ (p,)."""
        return np.asarray(self.prior.values + self.map @ unknowns, dtype=np.float64)

    def room(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least eigenvalues (bodies,) of 1 + X, of bodies with mass, and positive terms (k,)."""
        X = matrix(unknowns[: self.inside].reshape(-1, WIDTH))
        least = np.linalg.eigvalsh(np.eye(4) + X)[:, 0].astype(np.float64)
        return least, unknowns[self.positive] + self.levels

    def depth(self, unknowns: FloatArray) -> float:
        """Positive strictly inside all constraints; at most 1."""
        return float(np.concatenate(self.room(unknowns)).min(initial=1.0))

    def margins(self, unknowns: FloatArray) -> FloatArray:
        """Least eigenvalue (bodies,) of P relative to P0, of all bodies; NaN for massless ones."""
        least = dict(zip(self.prior.bodies, self.room(unknowns)[0], strict=True))
        found = np.array([least.get(body, np.nan) for body in self.prior.layout.bodies])
        return np.asarray(self.margin + (1 - self.margin) * found, dtype=np.float64)

    def boundary(self, unknowns: FloatArray) -> tuple[str, ...]:
        """Bodies, and joint terms, that lie on the boundary of what is consistent."""
        least, terms = self.room(unknowns)
        names = [b for b, low in zip(self.prior.bodies, least, strict=True) if low <= TOUCHING]
        names += [n for n, t in zip(self.positive_names, terms, strict=True) if t <= FLUSH]
        return tuple(dict.fromkeys(names))


def minimise(
    whitening: Whitening,
    data: FloatArray,
    target: FloatArray,
    regularisation: str,
    strength: float = 1.0,
    exact: bool = False,
    refuse: bool = True,
) -> FloatArray:
    """Unknowns x (q,) of least ½‖F x - g‖² + w distance, strictly inside all constraints.

    ``data`` is F (r, q), ``target`` g (r,), ``strength`` w. With ``exact`` F x = g is met instead
    (see ``attainable``). Without ``refuse`` a solution short of the tolerance is returned: it will
    do for a message.

    Raises
    ------
    OptionError
        When there is no such regularisation.
    MissingExtraError
        Without Clarabel.
    DataError
        When Clarabel does not reach its tolerance.
    """
    if regularisation not in REGULARISATIONS:
        raise OptionError.unknown("regularisation", regularisation, REGULARISATIONS)
    F, g = _rotated(data, target, whitening.inside)
    program, (r, q) = _Program(), F.shape
    x = program.unknowns(q)
    program.add_cost(x, quadratic=strength * _quadratic(whitening, regularisation))
    if exact:
        program.require("Zero", g, (x, F))
    else:
        misfit = program.unknowns(r)
        program.add_cost(misfit, quadratic=np.eye(r))
        program.require("Zero", g, (x, F), (misfit, -np.eye(r)))
    program.require_inside(whitening, DEPTH)
    for k in range(len(whitening.prior.bodies) if regularisation == "entropic" else 0):
        X, K, t = _body(k), program.unknowns(WIDTH), program.unknowns(4)
        program.add_cost(X, linear=strength * IDENTITY)
        program.add_cost(t, linear=np.full(4, -strength))
        program.require("PSDTriangle", LIFTED @ IDENTITY, (X, -LIFTED), (K, -LIFTED_FACTOR))
        for j, diagonal in enumerate(np.flatnonzero(IDENTITY)):
            log, bound = np.zeros((3, 4)), np.zeros((3, WIDTH))
            log[0, j] = bound[2, diagonal] = -1.0
            program.require("Exponential", np.array([0.0, 1.0, 0.0]), (t, log), (K, bound))
    solution = program.solution()
    gap = abs(solution.obj_val - solution.obj_val_dual)
    found = np.array(solution.x[x])
    if exact:
        found = _projected(found, F, g)
    solved = str(solution.status) in SOLVED and gap <= LARGEST_GAP * (1 + abs(solution.obj_val))
    if refuse and not (solved and whitening.depth(found) > 0):
        raise DataError(
            f"the consistent parameters do not converge: Clarabel ends with {solution.status}, its "
            f"objective certain to {gap:.1e} only: raise the strength of the prior, or the margin"
        )
    return found


def attainable(whitening: Whitening, data: FloatArray, target: FloatArray) -> bool:
    """Whether unknowns strictly inside all constraints satisfy F x = g, rows of size one.

    The least such unknowns prove it: they satisfy the equations to round-off and are inside.
    """
    program = _Program()
    x = program.unknowns(data.shape[1])
    program.add_cost(x, quadratic=np.eye(data.shape[1]))
    program.require("Zero", target, (x, data))
    program.require_inside(whitening, 2 * DEPTH)
    found = _projected(np.array(program.solution().x[x]), data, target)
    satisfied = np.abs(data @ found - target).max(initial=0.0) <= ROUND_OFF
    return bool(satisfied and whitening.depth(found) > DEPTH)


def _rotated(data: FloatArray, target: FloatArray, inside: int) -> tuple[FloatArray, FloatArray]:
    """The same misfit, with the first rows alone depending on the joint terms.

    No prior limits these. The other rows are orthogonal: as badly scaled as they may be, they stay
    apart.
    """
    count = data.shape[1] - inside
    turned, R = np.linalg.qr(data[:, inside:], mode="complete")
    F, g = turned.T @ data, turned.T @ target
    F[:, inside:] = R
    U, s, V = np.linalg.svd(F[count:], full_matrices=False)
    counted = s > NEGLIGIBLE * s.max(initial=0.0)
    F = np.concatenate([F[:count], (s[:, None] * V)[counted]])
    return F, np.concatenate([g[:count], (U.T @ g[count:])[counted]])


def _quadratic(whitening: Whitening, regularisation: str) -> FloatArray:
    """Q (q, q) of the part ½ xᵀ Q x of a regularisation."""
    prior, T = whitening.prior, whitening.map
    hidden = np.zeros(WIDTH) if prior.layout.full else TIE_BREAK * HIDDEN
    Q = np.diag(np.concatenate([np.zeros(whitening.inside), whitening.pull]))
    for k, (L, columns) in enumerate(zip(prior.factors, prior.columns, strict=True)):
        if regularisation == "riemannian":
            weights = np.where(hidden > 0, hidden, 1.0)
            Q[_body(k), _body(k)] = (1 - whitening.margin) ** 2 * np.diag(weights)
        elif regularisation == "euclidean":
            P = L @ L.T
            radius = np.sqrt((np.trace(P[:3, :3]) - P[3, :3] @ P[3, :3] / P[3, 3]) / P[3, 3])
            powers = prior.layout.parameters.select(columns).length_powers
            change = T[columns, _body(k)] / (P[3, 3] * radius**powers)[:, None]
            Q[_body(k), _body(k)] = change.T @ change + np.diag(hidden)
    return Q


def _projected(unknowns: FloatArray, data: FloatArray, target: FloatArray) -> FloatArray:
    """The nearest unknowns (q,) that meet the data to round-off."""
    inverse = np.linalg.pinv(data)
    for _ in range(2):  # the second time refines the first
        unknowns = unknowns + inverse @ (target - data @ unknowns)
    return unknowns


def _body(k: int) -> slice:
    return slice(WIDTH * k, WIDTH * (k + 1))


class _Program:
    """Minimise ½ zᵀ P z + cᵀ z where b - A z lies in cones: collected block by block."""

    def __init__(self) -> None:
        self.size = 0
        self.costs: list[tuple[slice, FloatArray | float, FloatArray | float]] = []
        self.rows: list[tuple[str, FloatArray, tuple[tuple[slice, FloatArray], ...]]] = []

    def unknowns(self, count: int) -> slice:
        """Places of new unknowns."""
        self.size += count
        return slice(self.size - count, self.size)

    def add_cost(
        self, place: slice, linear: FloatArray | float = 0.0, quadratic: FloatArray | float = 0.0
    ) -> None:
        self.costs.append((place, linear, quadratic))

    def require(self, cone: str, offset: FloatArray, *blocks: tuple[slice, FloatArray]) -> None:
        """Demand that the offset less the blocks times their unknowns lies in a cone."""
        if len(offset):
            self.rows.append((cone, offset, blocks))

    def require_inside(self, whitening: Whitening, depth: float) -> None:
        """Demand the constraints of a whitening, with some room."""
        count = whitening.map.shape[1]
        limits = slice(0, count), -np.eye(count)[whitening.positive]
        self.require("Nonnegative", whitening.levels - depth, limits)
        for k in range(len(whitening.prior.bodies)):
            self.require("PSDTriangle", (1 - depth) * IDENTITY, (_body(k), -np.eye(WIDTH)))

    def solution(self) -> Any:
        try:
            import clarabel
        except ImportError as error:
            raise MissingExtraError.of("clarabel", "sdp") from error
        from scipy.sparse import csc_matrix

        P, c = np.zeros((self.size, self.size)), np.zeros(self.size)
        for place, linear, quadratic in self.costs:
            c[place] += linear
            P[place, place] += quadratic
        b = np.concatenate([offset for _, offset, _ in self.rows])
        A, first, cones = np.zeros((len(b), self.size)), 0, []
        for cone, offset, blocks in self.rows:
            rows = len(offset)
            for place, block in blocks:
                A[first : first + rows, place] = block
            first += rows
            size = {"PSDTriangle": [int(np.sqrt(2 * rows))], "Exponential": []}.get(cone, [rows])
            cones.append(getattr(clarabel, f"{cone}ConeT")(*size))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
        P, A = csc_matrix(np.triu(P)), csc_matrix(A)
        return clarabel.DefaultSolver(P, c, A, b, cones, settings).solve()
