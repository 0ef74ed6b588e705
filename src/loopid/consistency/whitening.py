"""Whitening: every body in units of its prior.

With P0 = L Lᵀ the pseudo-inertia of the prior and a margin ε, unknowns X of a body are

    P = L (I + Z) Lᵀ,  Z = (1 - ε) X,  so that  I + X >= 0  means  P >= ε P0.

Zero is the prior, and one the size of the prior, for bodies of grams and of tonnes alike.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from loopid.arrays import FloatArray, frozen
from loopid.base_parameters import BaseParameters
from loopid.consistency.prior import Prior
from loopid.consistency.pseudo_inertia import IDENTITY, WIDTH, congruence, matrix, parameters_of
from loopid.regions import Region

# Weight of the tie-breaking pull on what has no prior, relative to what has one.
TIE_BREAK = 1e-6
# Relative to the prior: eigenvalues, and slacks, up to which a body or term is on the boundary.
TOUCHING, FLUSH = 1e-2, 1e-6


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
    faces : int
        Rows of A that belong to regions.
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
    faces: int
    start: FloatArray
    pull: FloatArray

    def __post_init__(self) -> None:
        for name in ("map", "slopes", "levels", "start", "pull"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def inside(self) -> int:
        """Number of unknowns that belong to bodies."""
        return WIDTH * len(self.prior.bodies)

    def bodies(self, unknowns: FloatArray) -> FloatArray:
        """I + X (bodies, 4, 4), of the bodies that are not massless."""
        return matrix(unknowns[: self.inside].reshape(-1, WIDTH) + IDENTITY)

    def slacks(self, unknowns: FloatArray) -> FloatArray:
        """A x + a (k,)."""
        return np.asarray(self.slopes @ unknowns + self.levels, dtype=np.float64)

    def allows(self, unknowns: FloatArray) -> bool:
        """Whether unknowns (q,) are strictly inside all constraints."""
        lowest = np.linalg.eigvalsh(self.bodies(unknowns)).min(initial=1.0)
        return bool(lowest > 0 and self.slacks(unknowns).min(initial=1.0) > 0)

    def without_rows(self, names: Collection[str]) -> Whitening:
        """The same without some of the joint terms' limits."""
        kept = [k for k, name in enumerate(self.row_names) if name not in names]
        return replace(
            self,
            slopes=self.slopes[kept],
            levels=self.levels[kept],
            row_names=tuple(self.row_names[k] for k in kept),
        )

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
        """Bodies, and terms of joints, that lie on the boundary of what is possible."""
        least, slacks = np.linalg.eigvalsh(self.bodies(unknowns))[:, 0], self.slacks(unknowns)
        names = [b for b, low in zip(self.prior.bodies, least, strict=True) if low <= TOUCHING]
        names += [n for n, s in zip(self.row_names, slacks, strict=True) if s <= FLUSH]
        return tuple(dict.fromkeys(names))


def whiten(
    base: BaseParameters, prior: Prior, regions: Mapping[str, Region], margin: float
) -> Whitening:
    """Whitened unknowns of all parameters of a robot.

    Parameters
    ----------
    prior : Prior
        Strictly inside all constraints.
    regions : mapping
        From names of bodies.
    margin : float
        Least eigenvalue of P relative to the prior's, and part of a region that stays free.
    """
    layout = prior.layout
    joint_values = prior.values[layout.joint_columns]
    known = joint_values != 0
    T = _unit_changes(prior, np.where(known, np.abs(joint_values), _sizes(base, prior)), margin)
    start = np.concatenate([np.zeros(WIDTH * len(prior.bodies)), np.where(known, 0.0, 1.0)])
    faces = tuple(b for b in prior.bodies if b in regions for _ in regions[b].offsets)
    joints = tuple(layout.parameters[j].label for j in layout.positive)
    rows = np.concatenate([_region_rows(prior, regions, margin), np.eye(len(T))[layout.positive]])
    slacks = rows @ (prior.values + T @ start)
    return Whitening(
        prior=prior,
        margin=margin,
        map=T,
        slopes=rows @ T / slacks[:, None],
        levels=rows @ prior.values / slacks,
        row_names=(*faces, *joints),
        faces=len(faces),
        start=start,
        pull=np.where(known, 1.0, TIE_BREAK),
    )


def _unit_changes(prior: Prior, scales: FloatArray, margin: float) -> FloatArray:
    """T (p, q): ten unknowns a body, then the joint terms by their scales (k,)."""
    layout, inside = prior.layout, WIDTH * len(prior.bodies)
    T = np.zeros((len(layout.parameters), inside + len(scales)))
    for k, columns in enumerate(prior.columns):
        units = matrix(congruence(prior.factors[k]).T)
        images = (1 - margin) * parameters_of(units)
        T[columns, WIDTH * k : WIDTH * (k + 1)] = images[:, : len(columns)].T
    T[layout.joint_columns, inside + np.arange(len(scales))] = scales
    return T


def _sizes(base: BaseParameters, prior: Prior) -> FloatArray:
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
