"""The convex problem that all solvers solve, in whitened unknowns.

minimise   ½‖F x - g‖² + ½ xᵀ Q x + w Σ (tr X - log det(I + X))
subject to I + X >= 0 for every body and A x + a >= 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray
from loopid.consistency.regularisation import quadratic_part
from loopid.consistency.whitening import Whitening

# Singular values of the data below this part of the largest tell nothing.
TELLING = 1e-14


@dataclass(frozen=True, eq=False)
class ConvexProblem:
    """Data, regularisation and constraints in whitened unknowns (q,).

    Attributes
    ----------
    whitening : Whitening
    data : FloatArray
        F (r, q); the terms of joints only in its first rows.
    target : FloatArray
        g (r,).
    quadratic : FloatArray
        Q (q, q).
    strength : float
        w, weight of the regularisation.
    entropic : bool
        Whether the entropic part is there; Q holds the others.
    exact : bool
        Whether the data are to be met exactly: F x = g instead of the first term.
    """

    whitening: Whitening
    data: FloatArray
    target: FloatArray
    quadratic: FloatArray
    strength: float
    entropic: bool
    exact: bool = False

    def objective(self, unknowns: FloatArray) -> float:
        """What is minimised, at unknowns (q,) inside the constraints."""
        value = self.misfit(unknowns) + 0.5 * float(unknowns @ self.quadratic @ unknowns)
        return value + self.strength * self.divergence(unknowns) if self.entropic else value

    def misfit(self, unknowns: FloatArray) -> float:
        """½‖F x - g‖²."""
        return 0.5 * float(((self.data @ unknowns - self.target) ** 2).sum())

    def divergence(self, unknowns: FloatArray) -> float:
        """Σ (tr X - log det(I + X)); infinite where a body is not positive definite."""
        eigenvalues = np.linalg.eigvalsh(self.whitening.bodies(unknowns))
        if not (eigenvalues > 0).all():
            return np.inf
        return float((eigenvalues - 1 - np.log(eigenvalues)).sum())


def convex_problem(
    whitening: Whitening,
    data: FloatArray,
    target: FloatArray,
    regularisation: str,
    strength: float,
    exact: bool = False,
) -> ConvexProblem:
    """The problem for data (r, q) with targets (r,).

    The data are turned so that only the first rows depend on the terms of joints, which no prior
    holds, and so that the others are orthogonal: as badly scaled as they may be, they stay apart.
    """
    joints = np.arange(whitening.inside, data.shape[1])
    turned, R = np.linalg.qr(data[:, joints], mode="complete")
    F, g = turned.T @ data, turned.T @ target
    F[:, joints] = R
    rest = slice(len(joints), None)
    U, s, V = np.linalg.svd(F[rest], full_matrices=False)
    telling = s > TELLING * s.max(initial=0.0)
    F = np.concatenate([F[: len(joints)], (s[:, None] * V)[telling]])
    g = np.concatenate([g[: len(joints)], (U.T @ g[rest])[telling]])
    Q = strength * quadratic_part(whitening, regularisation)
    return ConvexProblem(whitening, F, g, Q, strength, regularisation == "entropic", exact)
