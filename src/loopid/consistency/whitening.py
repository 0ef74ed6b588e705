"""The convex problem of the consistent fit, with every body in units of its prior.

With P0 = L Lᵀ the pseudo-inertia of the prior and a margin ε, the unknowns X of a body are

    P = L (1 + Z) Lᵀ,  Z = (1 - ε) X,  so that  1 + X >= 0  means  P >= ε P0.

Zero is the prior, and one the size of the prior, for bodies of grams and of tonnes alike. The
distances from the prior, summed over the bodies, are [Wensing2018; Lee2018; Lee2020]

- entropic, tr X - log det(1 + X): the Bregman divergence of -log det, from P to the prior;
- Riemannian, ½‖Z‖²: half the squared length of P - P0 in the affine-invariant metric at P0, the
  "constant pull-back" of the geodesic distance;
- Euclidean, ½ of the sum of squared changes of the ten parameters, in units of the body's mass m
  and of its mean radius ρ about the centre of mass: m, m ρ and m ρ².

The first two depend neither on units nor on frames.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from loopid.arrays import FloatArray, frozen
from loopid.base_parameters import BaseParameters
from loopid.consistency.prior import Prior
from loopid.errors import OptionError
from loopid.pseudo_inertia import parameters_of
from loopid.regions import Region

REGULARISATIONS = ("entropic", "euclidean", "riemannian")
# Weight of the tie-breaking pull on what has no prior, relative to what has one.
TIE_BREAK = 1e-6
# Relative to the prior: eigenvalues, and slacks, up to which a body or term is on the boundary.
TOUCHING, FLUSH = 1e-2, 1e-5
# Singular values of the data below this part of the largest are round-off.
NEGLIGIBLE = 1e-14

# Symmetric matrices (4, 4) as vectors (10,): the upper triangle column by column, as Clarabel wants
# it, off-diagonal entries times √2, so that tr(A B) = aᵀ b.
COLUMNS, ROWS = np.tril_indices(4)
WIDTH = len(ROWS)
SCALES = np.where(ROWS == COLUMNS, 1.0, np.sqrt(2.0))
IDENTITY = np.eye(4)[ROWS, COLUMNS]
# Entries that only second moments depend on, which the gravity model does not have.
HIDDEN = (ROWS < 3) & (COLUMNS < 3)


def vector(matrix: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 4, 4) as vectors (..., 10)."""
    return np.asarray(matrix[..., ROWS, COLUMNS] * SCALES, dtype=np.float64)


def matrix(vectors: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 4, 4) of vectors (..., 10)."""
    found = np.empty((*vectors.shape[:-1], 4, 4))
    found[..., ROWS, COLUMNS] = found[..., COLUMNS, ROWS] = vectors / SCALES
    return found


@dataclass(frozen=True, eq=False)
class Whitening:
    """Standard parameters Φ = Φ0 + T x of whitened unknowns x, and what x must obey.

    Unknowns are ten a body, then one a joint term.

    Attributes
    ----------
    prior : Prior
    margin : float
    map : FloatArray
        T (p, q).
    slopes, levels : FloatArray
        A (k, q) and a (k,): A x + a >= 0 keeps centres of mass in their regions and friction
        positive; 1 at the start.
    row_names : tuple of str
        Bodies, then joint terms, that the rows of A limit.
    start : FloatArray
        (q,), unknowns strictly inside all constraints.
    pull : FloatArray
        Weights of the joint terms in any regularisation.
    """

    prior: Prior
    margin: float
    map: FloatArray
    slopes: FloatArray
    levels: FloatArray
    row_names: tuple[str, ...]
    start: FloatArray
    pull: FloatArray

    def __post_init__(self) -> None:
        for name in ("map", "slopes", "levels", "start", "pull"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @classmethod
    def about(
        cls, base: BaseParameters, prior: Prior, regions: Mapping[str, Region], margin: float
    ) -> Whitening:
        """Whitened unknowns about a prior that is strictly inside its regions."""
        layout = prior.layout
        known = prior.values[layout.joint_columns] != 0
        sizes = np.where(
            known, np.abs(prior.values[layout.joint_columns]), _joint_sizes(base, prior)
        )
        T = _unit_changes(prior, sizes, margin)
        start = np.concatenate([np.zeros(WIDTH * len(prior.bodies)), np.where(known, 0.0, 1.0)])
        faces = tuple(b for b in prior.bodies if b in regions for _ in regions[b].offsets)
        joints = tuple(layout.parameters[int(j)].label for j in layout.positive)
        rows = np.vstack([_region_rows(prior, regions, margin), np.eye(len(T))[layout.positive]])
        slacks = rows @ (prior.values + T @ start)
        return cls(
            prior=prior,
            margin=margin,
            map=T,
            slopes=rows @ T / slacks[:, None],
            levels=rows @ prior.values / slacks,
            row_names=(*faces, *joints),
            start=start,
            pull=np.where(known, 1.0, TIE_BREAK),
        )

    @property
    def inside(self) -> int:
        """Number of unknowns that belong to bodies."""
        return WIDTH * len(self.prior.bodies)

    def bodies(self, unknowns: FloatArray) -> FloatArray:
        """1 + X (bodies, 4, 4), of the bodies that are not massless."""
        return matrix(unknowns[: self.inside].reshape(-1, WIDTH) + IDENTITY)

    def depth(self, unknowns: FloatArray) -> float:
        """Least eigenvalue of 1 + X and least A x + a: positive strictly inside all constraints."""
        least = np.linalg.eigvalsh(self.bodies(unknowns)).min(initial=1.0)
        slacks = self.slopes @ unknowns + self.levels
        return float(min(least, slacks.min(initial=1.0)))

    def without_rows(self, names: Collection[str]) -> Whitening:
        """The same without some of the joint terms' limits."""
        kept = [k for k, name in enumerate(self.row_names) if name not in names]
        names = tuple(self.row_names[k] for k in kept)
        return replace(self, slopes=self.slopes[kept], levels=self.levels[kept], row_names=names)

    def standard_parameters(self, unknowns: FloatArray) -> FloatArray:
        """Φ (p,)."""
        return np.asarray(self.prior.values + self.map @ unknowns, dtype=np.float64)

    def margins(self, unknowns: FloatArray) -> FloatArray:
        """Least eigenvalue (bodies,) of P relative to P0, of all bodies; NaN for massless ones."""
        least = np.linalg.eigvalsh(self.bodies(unknowns))[:, 0]
        relative = dict(zip(self.prior.bodies, least, strict=True))
        found = np.array([relative.get(body, np.nan) for body in self.prior.layout.bodies])
        return np.asarray(self.margin + (1 - self.margin) * found, dtype=np.float64)

    def boundary(self, unknowns: FloatArray) -> tuple[str, ...]:
        """Bodies, and joint terms, that lie on the boundary of what is consistent."""
        least = np.linalg.eigvalsh(self.bodies(unknowns))[:, 0]
        slacks = self.slopes @ unknowns + self.levels
        names = [b for b, low in zip(self.prior.bodies, least, strict=True) if low <= TOUCHING]
        names += [n for n, s in zip(self.row_names, slacks, strict=True) if s <= FLUSH]
        return tuple(dict.fromkeys(names))


def _unit_changes(prior: Prior, sizes: FloatArray, margin: float) -> FloatArray:
    """T (p, q): ten unknowns a body, then the joint terms in their sizes (k,)."""
    layout, inside = prior.layout, WIDTH * len(prior.bodies)
    T = np.zeros((len(layout.parameters), inside + len(sizes)))
    units = matrix(np.eye(WIDTH))
    for k, (L, columns) in enumerate(zip(prior.factors, prior.columns, strict=True)):
        images = (1 - margin) * parameters_of(L @ units @ L.T)
        T[columns, WIDTH * k : WIDTH * (k + 1)] = images[:, : len(columns)].T
    T[layout.joint_columns, inside + np.arange(len(sizes))] = sizes
    return T


def _joint_sizes(base: BaseParameters, prior: Prior) -> FloatArray:
    """For each joint term (k,) the value at which it weighs as much as the whole prior."""
    F = np.zeros((base.structure.rank, len(base.parameters)))
    F[:, base.structure.columns] = base.structure.row_factor
    weights = np.linalg.norm(F[:, prior.layout.joint_columns], axis=0)
    whole = float(np.linalg.norm(F @ prior.values)) or 1.0
    sizes = np.divide(whole, weights, out=np.ones(len(weights)), where=weights > 0)
    return np.asarray(sizes, dtype=np.float64)


def _region_rows(prior: Prior, regions: Mapping[str, Region], margin: float) -> FloatArray:
    """Rows (k, p) of d m - n·h >= 0 for regions shrunk by the margin."""
    rows = [np.zeros((0, len(prior.values)))]
    for body, columns in zip(prior.bodies, prior.columns, strict=True):
        if body in regions:
            region = regions[body]
            offsets = region.offsets - margin * region.depths(region.centre)
            block = np.zeros((len(offsets), len(prior.values)))
            block[:, columns[:4]] = np.column_stack([offsets, -region.normals])
            rows.append(block)
    return np.concatenate(rows)


@dataclass(frozen=True, eq=False)
class ConvexProblem:
    """Minimise ½‖F x - g‖² + ½ xᵀ Q x + w Σ (tr X - log det(1 + X)) in whitened unknowns (q,).

    Attributes
    ----------
    whitening : Whitening
        With the constraints 1 + X >= 0 for every body and A x + a >= 0.
    data : FloatArray
        F (r, q).
    target : FloatArray
        g (r,).
    quadratic : FloatArray
        Q (q, q).
    strength : float
        w, weight of the regularisation.
    entropic : bool
        Whether the entropic part is there; Q holds the others.
    """

    whitening: Whitening
    data: FloatArray
    target: FloatArray
    quadratic: FloatArray
    strength: float
    entropic: bool

    @classmethod
    def of(
        cls,
        whitening: Whitening,
        data: FloatArray,
        target: FloatArray,
        regularisation: str,
        strength: float,
    ) -> ConvexProblem:
        """The problem for data (r, q) with targets (r,).

        The data are rotated so that only the first rows depend on the joint terms, which no prior
        limits, and so that the others are orthogonal: as badly scaled as they may be, they stay
        apart.

        Raises
        ------
        OptionError
            When there is no such regularisation.
        """
        joints = np.arange(whitening.inside, data.shape[1])
        turned, R = np.linalg.qr(data[:, joints], mode="complete")
        F, g = turned.T @ data, turned.T @ target
        F[:, joints] = R
        rest = slice(len(joints), None)
        U, s, V = np.linalg.svd(F[rest], full_matrices=False)
        counted = s > NEGLIGIBLE * s.max(initial=0.0)
        F = np.concatenate([F[: len(joints)], (s[:, None] * V)[counted]])
        g = np.concatenate([g[: len(joints)], (U.T @ g[rest])[counted]])
        Q = strength * _quadratic_part(whitening, regularisation)
        return cls(whitening, F, g, Q, strength, regularisation == "entropic")

    def objective(self, unknowns: FloatArray) -> float:
        """What is minimised; infinite where a body is not positive definite."""
        misfit = 0.5 * float(((self.data @ unknowns - self.target) ** 2).sum())
        return misfit + self.distance(unknowns)

    def distance(self, unknowns: FloatArray) -> float:
        """The regularisation alone."""
        value = 0.5 * float(unknowns @ self.quadratic @ unknowns)
        if self.entropic:
            eigenvalues = np.linalg.eigvalsh(self.whitening.bodies(unknowns))
            if not (eigenvalues > 0).all():
                return np.inf
            value += self.strength * float((eigenvalues - 1 - np.log(eigenvalues)).sum())
        return value


def _quadratic_part(whitening: Whitening, regularisation: str) -> FloatArray:
    """Q (q, q) of the part ½ xᵀ Q x of a regularisation."""
    if regularisation not in REGULARISATIONS:
        raise OptionError.unknown("regularisation", regularisation, REGULARISATIONS)
    prior, size = whitening.prior, whitening.map.shape[1]
    visible = np.ones(WIDTH) if prior.layout.full else np.where(HIDDEN, TIE_BREAK, 1.0)
    Q = np.zeros((size, size))
    for k in range(len(prior.bodies)):
        block = slice(WIDTH * k, WIDTH * (k + 1))
        if regularisation == "riemannian":
            Q[block, block] = (1 - whitening.margin) ** 2 * np.diag(visible)
        elif regularisation == "euclidean":
            change = _relative_change(whitening, k)
            Q[block, block] = change.T @ change + np.diag(np.where(visible < 1, visible, 0.0))
    joints = np.arange(whitening.inside, size)
    Q[joints, joints] = whitening.pull
    return Q


def _relative_change(whitening: Whitening, k: int) -> FloatArray:
    """The map (width, 10) from the unknowns of a body to its relative changes."""
    prior, columns = whitening.prior, whitening.prior.columns[k]
    P = prior.factors[k] @ prior.factors[k].T
    radius = np.sqrt((np.trace(P[:3, :3]) - P[3, :3] @ P[3, :3] / P[3, 3]) / P[3, 3])
    powers = prior.layout.parameters.select(columns).length_powers
    change = whitening.map[columns, WIDTH * k : WIDTH * (k + 1)]
    return np.asarray(change / (P[3, 3] * radius**powers)[:, None], dtype=np.float64)
